"""Discovery of runs that accept foreign policy hosts.

A run writes an endpoint descriptor to `<base>/<run>/attach/<name>.json` for every policy of kind `attach:NAME`. The
base folder belongs to the user. Every process of a run holds a shared lock on a file in the run's folder, which
distinguishes a run in progress from one that was killed.
"""

import fcntl
import json
import os
import re
import time
from dataclasses import dataclass
from pathlib import Path

from .execution import CHUNK, ENSEMBLE, Requested
from .layout import MAX_HORIZON, MORPHOLOGIES, SCHEMA_HASH
from .trust import NAME, check_base, is_run, prefix_of, read_own

# Lock file in a run's folder.
LOCK_NAME = "claim.lock"
POLL_INTERVAL_S = 0.05
# Longest descriptor in bytes; the program writes about a thousand.
MAX_BYTES = 1 << 16
# Sizes of images, those of the wrist only if they differ.
IMAGE_SIZES = re.compile(r"([0-9]{2,4})x([0-9]{2,4})(?:,wrist=([0-9]{2,4})x([0-9]{2,4}))?")
# Largest numbers of a lane.
MAX_ENVS, MAX_BLOCK_PAGES, MAX_IN_FLIGHT, MAX_LANES, MAX_TIMEOUT_S = 1 << 20, 1 << 16, 1 << 10, 1 << 16, 1 << 24


class EndpointError(Exception):
    """An endpoint descriptor that cannot be parsed, or that belongs to another version of the program."""


class EndpointTimeout(TimeoutError):
    """No run has offered an endpoint in time."""


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
    images: "tuple | None"
    """Sizes of external and hand images, (width, height) each; None if the run renders none for this policy."""
    answer_timeout_s: int
    """Time after which the run waits for an answer no longer."""
    execute: int
    """Rows of an action chunk that the simulator will execute at most."""
    mode: str
    """`chunk`, or `ensemble` if the policy is queried at every control step and its predictions are averaged."""
    requested: Requested
    """What the user asked for, of which `mode` and `execute` follow."""

    def run_is_alive(self):
        """Return whether any process of the run is alive."""
        return is_locked(self.root)


def base_folder() -> Path:
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
        EndpointTimeout: No run offers the endpoint within `timeout_s`.
        TrustError: Another user could have made the endpoint.
        EndpointError: A run offers an endpoint that this package cannot use.
    """
    if not NAME.fullmatch(name):
        raise EndpointError(f"{name!r} is no name of an endpoint, expected 1 to 64 letters, digits, `.`, `_` or `-`")
    base = Path(base) if base is not None else base_folder()
    deadline = None if timeout_s is None else time.monotonic() + timeout_s
    while True:
        endpoint = find_endpoint(name, base, served)
        if endpoint is not None:
            return endpoint
        if deadline is not None and time.monotonic() >= deadline:
            raise EndpointTimeout(
                f"no run under {base} offered an endpoint {name!r} within {timeout_s:g} s; "
                f"start one with `hypogeum run --policy NAME=attach:{name}`"
            )
        time.sleep(POLL_INTERVAL_S)


def find_endpoint(name, base, served=()) -> "EndpointDescriptor | None":
    """Return what `wait_for_endpoint` would, or None if there is no such endpoint now."""
    check_base(base)
    found = []
    for root in filter(is_run, Path(base).glob("*")):
        path = root / "attach" / f"{name}.json"
        try:
            found.append((path.lstat().st_mtime_ns, path))
        except FileNotFoundError:
            continue
    for _, path in sorted(found, reverse=True):
        if path in served or not is_locked(path.parent.parent):
            continue
        try:
            return parse(path, read_own(path, MAX_BYTES))
        except FileNotFoundError:
            continue
        except (OSError, ValueError) as error:
            raise EndpointError(f"{path} is not an endpoint descriptor that this package can read: {error}") from error
    return None


def parse(path, text):
    """Parse an endpoint descriptor from `text`, the contents of the file `path`."""
    try:
        fields = json.loads(text)
        schema_hash = int(fields["schema_hash"], 16)
        if schema_hash != SCHEMA_HASH:
            raise EndpointError(schema_message(schema_hash))
        domain, lane, requested = fields["domain"], fields["lane"], fields["requested"]
        # Names of files are made from where the descriptor lies, never from what it says.
        root = path.parent.parent
        one_of("domain.root", domain["root"], [str(root)])
        one_of("domain.prefix", domain["prefix"], [prefix_of(root)])
        if not isinstance(lane["policy"], str) or not NAME.fullmatch(lane["policy"]):
            raise ValueError(f"lane.policy is {lane['policy']!r}, expected the name of a policy")
        return EndpointDescriptor(
            path=path,
            root=root,
            prefix=prefix_of(root),
            run=number("run", fields["run"], 0, (1 << 64) - 1),
            lane=number("lane.lane", lane["lane"], 0, MAX_LANES),
            policy=lane["policy"],
            max_envs=number("lane.max_envs", lane["max_envs"], 1, MAX_ENVS),
            block_pages=number("lane.block_pages", lane["block_pages"], 1, MAX_BLOCK_PAGES),
            in_flight=number("lane.in_flight", lane["in_flight"], 1, MAX_IN_FLIGHT),
            morphologies=tuple(one_of("morphologies", name, MORPHOLOGIES) for name in fields["morphologies"]),
            images=image_sizes(fields["images"]),
            answer_timeout_s=number("answer_timeout_s", fields["answer_timeout_s"], 1, MAX_TIMEOUT_S),
            execute=number("execute", fields["execute"], 1, MAX_HORIZON),
            mode=one_of("mode", fields["mode"], [CHUNK, ENSEMBLE]),
            requested=Requested(
                one_of("requested.mode", requested.get("mode"), [None, CHUNK, ENSEMBLE]),
                None if requested.get("execute") is None
                else number("requested.execute", requested["execute"], 1, MAX_HORIZON),
            ),
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise EndpointError(f"{path} is not an endpoint descriptor that this package can read: {reason[:200]}") from error


def image_sizes(found):
    """Return the sizes of external and hand images, which a descriptor gives as `WxH` or `WxH,wrist=WxH`."""
    if found is None:
        return None
    match = IMAGE_SIZES.fullmatch(found) if isinstance(found, str) else None
    if match is None:
        raise ValueError(f"images is {found!r}, expected null or sizes such as 640x480 or 224x224,wrist=128x128")
    width, height, *hand = (None if length is None else int(length) for length in match.groups())
    return (width, height), (tuple(hand) if hand[0] is not None else (width, height))


def number(name, found, low, high):
    """Return a whole number from a descriptor, after checking it."""
    if type(found) is not int or not low <= found <= high:
        raise ValueError(f"{name} is {found!r}, expected a whole number from {low} to {high}")
    return found


def one_of(name, found, expected):
    """Return a value from a descriptor, after checking that it is one of those expected."""
    for value in expected:
        if type(found) is type(value) and found == value:
            return found
    raise ValueError(f"{name} is {found!r}, expected {' or '.join(map(repr, expected))}")


def schema_message(found):
    """Return the error message for a run with link schema `found`."""
    return (
        f"the run uses link schema {found:#018x}, this package uses {SCHEMA_HASH:#018x}; "
        "install the package version that matches the hypogeum binary"
    )


def is_locked(root):
    """Return whether any process holds the lock of the run in folder `root`."""
    try:
        lock = os.open(root / LOCK_NAME, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError:
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return False
    except BlockingIOError:
        return True
    finally:
        os.close(lock)
