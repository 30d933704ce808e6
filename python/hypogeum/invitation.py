"""Where runs invite policies to attach: `<base>/<run>/attach/<name>.json`.

The base folder is the user's own. A run holds a lock on its folder as long as any process of it lives, so that the
invitation of a run that was killed is known for what it is.
"""

import fcntl
import json
import os
import time
from dataclasses import dataclass
from pathlib import Path

# The lock of a run, in its folder.
CLAIM = "claim.lock"
# Pause between two looks for an invitation, in seconds.
PAUSE_S = 0.05


class InvitationError(Exception):
    """An invitation that cannot be read."""


@dataclass(frozen=True)
class Invitation:
    """What a run tells a policy that wants to attach."""

    path: Path
    root: Path
    """The run's folder."""
    prefix: str
    """First part of the names of its shared memory."""
    run: int
    """Random number of the run."""
    lane: int
    policy: str
    """Name of the policy in the run's results."""
    max_envs: int
    """Most envs in a message."""
    block_pages: int
    """Pages of an env in an observation message, the largest if they differ."""
    in_flight: int
    """Most observations that may be unanswered at a time."""
    schema_hash: int
    morphologies: tuple
    """Names of the morphologies of its tasks."""
    images: bool
    execute: int
    """Rows of an answer that will be executed."""
    mode: str
    """`chunk`, or `ensemble`: then every control step is asked for, and answered by the mean of all predictions for it."""

    def run_is_alive(self):
        """Whether any process of the run lives."""
        return is_claimed(self.root)


def base_folder():
    """The folder under which the runs of this user live."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and Path(runtime).is_dir():
        return Path(runtime) / "hypogeum"
    return Path(f"/tmp/hypogeum_{os.getuid()}")


def wait_for_invitation(name, base=None, timeout_s=None, served=()):
    """The invitation `name` of the newest living run that is not among `served`; waits for one."""
    base = Path(base) if base is not None else base_folder()
    deadline = None if timeout_s is None else time.monotonic() + timeout_s
    while True:
        invitation = find_invitation(name, base, served)
        if invitation is not None:
            return invitation
        if deadline is not None and time.monotonic() >= deadline:
            raise TimeoutError(
                f"no run under {base} has invited {name!r} within {timeout_s:g} s; "
                f"start one with `hypogeum run --policy NAME=attach:{name}`"
            )
        time.sleep(PAUSE_S)


def find_invitation(name, base, served=()):
    """As `wait_for_invitation`, but None if there is none now."""
    found = []
    for path in Path(base).glob(f"*/attach/{name}.json"):
        try:
            found.append((path.stat().st_mtime_ns, path))
        except FileNotFoundError:
            continue
    for _, path in sorted(found, reverse=True):
        if path in served or not is_claimed(path.parent.parent):
            continue
        try:
            return parse(path, path.read_text())
        except FileNotFoundError:
            continue
    return None


def parse(path, text):
    """The invitation in a file's text."""
    try:
        note = json.loads(text)
        domain, lane = note["domain"], note["lane"]
        return Invitation(
            path=path,
            root=Path(domain["root"]),
            prefix=domain["prefix"],
            run=note["run"],
            **{field: lane[field] for field in ("lane", "policy", "max_envs", "block_pages", "in_flight")},
            schema_hash=int(note["schema_hash"], 16),
            morphologies=tuple(note["morphologies"]),
            images=note["images"],
            execute=note["execute"],
            mode=note["mode"],
        )
    except (ValueError, KeyError, TypeError) as error:
        raise InvitationError(f"{path} is not an invitation that this package understands: {error!r}") from error


def is_claimed(root):
    """Whether a process holds the lock of this run's folder."""
    try:
        lock = os.open(root / CLAIM, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return False
    except BlockingIOError:
        return True
    finally:
        os.close(lock)
