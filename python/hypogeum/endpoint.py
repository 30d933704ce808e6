"""Discovery of runs that accept foreign policy hosts.

A run writes an endpoint descriptor to `<base>/<run>/attach/<name>.json` for every policy of kind `attach:NAME`. The
base folder belongs to the user. Every process of a run holds a shared lock on a file in the run's folder, which
distinguishes a run in progress from one that was killed.
"""

import fcntl
import json
import os
import time
from dataclasses import dataclass
from pathlib import Path

from .execution import Requested
from .layout import SCHEMA_HASH

# Lock file in a run's folder.
LOCK_NAME = "claim.lock"
POLL_INTERVAL_S = 0.05


class EndpointError(Exception):
    """An endpoint descriptor that cannot be parsed, or that belongs to another version of the program."""


@dataclass(frozen=True)
class EndpointDescriptor:
    """Everything a foreign policy host needs to attach to a lane of a run."""

    path: Path
    root: Path
    """Folder of the run."""
    prefix: str
    """Prefix of the names of the run's shared memory segments."""
    run: int
    """Random number that identifies the run."""
    lane: int
    policy: str
    """Name of the policy in the run's results."""
    max_envs: int
    """Maximum number of envs in a message."""
    block_pages: int
    """Pages of one env in an observation message, the largest number if morphologies differ."""
    in_flight: int
    """Maximum number of unanswered observations."""
    morphologies: tuple
    """Names of the morphologies of the run's tasks."""
    images: bool
    execute: int
    """Rows of an action chunk that the simulator will execute at most."""
    mode: str
    """`chunk`, or `ensemble` if the policy is queried at every control step and its predictions are averaged."""
    requested: Requested
    """What the user asked for, of which `mode` and `execute` follow."""

    def run_is_alive(self):
        """Return whether any process of the run is alive."""
        return is_locked(self.root)


def base_folder():
    """Return the folder that contains the runs of this user."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and Path(runtime).is_absolute() and Path(runtime).is_dir():
        return Path(runtime) / "hypogeum"
    return Path(f"/tmp/hypogeum_{os.getuid()}")


def wait_for_endpoint(name, base=None, timeout_s=None, served=()):
    """Wait for an endpoint called `name` and return its descriptor.

    Args:
        name: NAME of `hypogeum run --policy ...=attach:NAME`.
        base: Folder that contains the runs; `base_folder()` by default.
        timeout_s: Maximum wait in seconds, or None to wait indefinitely.
        served: Paths of descriptors to ignore.

    Returns:
        The `EndpointDescriptor` of the newest live run.

    Raises:
        TimeoutError: No run offers the endpoint within `timeout_s`.
    """
    base = Path(base) if base is not None else base_folder()
    deadline = None if timeout_s is None else time.monotonic() + timeout_s
    while True:
        endpoint = find_endpoint(name, base, served)
        if endpoint is not None:
            return endpoint
        if deadline is not None and time.monotonic() >= deadline:
            raise TimeoutError(
                f"no run under {base} offered an endpoint {name!r} within {timeout_s:g} s; "
                f"start one with `hypogeum run --policy NAME=attach:{name}`"
            )
        time.sleep(POLL_INTERVAL_S)


def find_endpoint(name, base, served=()):
    """Return what `wait_for_endpoint` would, or None if there is no such endpoint now."""
    found = []
    for path in Path(base).glob(f"*/attach/{name}.json"):
        try:
            found.append((path.stat().st_mtime_ns, path))
        except FileNotFoundError:
            continue
    for _, path in sorted(found, reverse=True):
        if path in served or not is_locked(path.parent.parent):
            continue
        try:
            return parse(path, path.read_text())
        except FileNotFoundError:
            continue
    return None


def parse(path, text):
    """Parse an endpoint descriptor from `text`, the contents of the file `path`."""
    try:
        fields = json.loads(text)
        schema_hash = int(fields["schema_hash"], 16)
        if schema_hash != SCHEMA_HASH:
            raise EndpointError(schema_message(schema_hash))
        domain, lane = fields["domain"], fields["lane"]
        return EndpointDescriptor(
            path=path,
            root=Path(domain["root"]),
            prefix=domain["prefix"],
            run=fields["run"],
            **{field: lane[field] for field in ("lane", "policy", "max_envs", "block_pages", "in_flight")},
            morphologies=tuple(fields["morphologies"]),
            images=fields["images"],
            execute=fields["execute"],
            mode=fields["mode"],
            requested=Requested(**fields["requested"]),
        )
    except (ValueError, KeyError, TypeError) as error:
        raise EndpointError(f"{path} is not an endpoint descriptor that this package can read: {error!r}") from error


def schema_message(found):
    """Return the error message for a run with link schema `found`."""
    return (
        f"the run uses link schema {found:#018x}, this package uses {SCHEMA_HASH:#018x}; "
        "install the package version that matches the hypogeum binary"
    )


def is_locked(root):
    """Return whether any process holds the lock of the run in folder `root`."""
    try:
        lock = os.open(root / LOCK_NAME, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return False
    except BlockingIOError:
        return True
    finally:
        os.close(lock)
