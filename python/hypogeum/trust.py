"""Which files of a run may be used: only those of this user, in folders that nobody else can change.

Everybody can create files in /tmp and /dev/shm, with any name. The built-in programs check the same
(`orchestrator/src/fleet/folder.rs`, `ipc-types/src/link/domain.rs`).
"""

import os
import re
import stat
from pathlib import Path

# Name of a run's folder: the low 48 bits of its random number.
TAG = re.compile(r"[0-9a-f]{12}")
# Names of policies and endpoints, which become names of files.
NAME = re.compile(r"(?!\.)[A-Za-z0-9._-]{1,64}")
OTHERS = 0o077
OPEN_WITHOUT_STICKY_BIT = (0o002, 0o1000)


class TrustError(Exception):
    """A folder that another user could have made or could change."""


def check_base(base):
    """Check the folder that contains the runs of this user, if it exists.

    Raises:
        TrustError: It is no folder, belongs to another user, or others may change it or a folder above it.
    """
    base = Path(base)
    try:
        status = os.lstat(base)
    except FileNotFoundError:
        return
    if not stat.S_ISDIR(status.st_mode):
        found = "a symbolic link" if stat.S_ISLNK(status.st_mode) else "no folder"
        raise TrustError(f"{base}, the folder of all runs, is {found}; remove it, or set XDG_RUNTIME_DIR to another folder")
    if status.st_uid != os.getuid():
        raise TrustError(f"{base}, the folder of all runs, belongs to user {status.st_uid}; set XDG_RUNTIME_DIR to one of yours")
    if status.st_mode & OTHERS:
        mode = stat.S_IMODE(status.st_mode)
        raise TrustError(f"{base}, the folder of all runs, is open to others (mode {mode:04o}); close it: chmod 700 {base}")
    writable, sticky = OPEN_WITHOUT_STICKY_BIT
    for parent in base.absolute().parents:
        mode = os.stat(parent).st_mode
        if mode & writable and not mode & sticky:
            mode = stat.S_IMODE(mode)
            raise TrustError(f"everybody can replace folders in {parent} (mode {mode:04o}); set XDG_RUNTIME_DIR to another folder")


def is_own(path, is_kind):
    """Return whether `path` itself, not what a link points to, is of a kind (such as `stat.S_ISREG`) and this user's."""
    try:
        status = os.lstat(path)
    except OSError:
        return False
    return is_kind(status.st_mode) and status.st_uid == os.getuid()


def is_run(root):
    """Return whether `root` is the folder of a run of this user."""
    return TAG.fullmatch(Path(root).name) is not None and is_own(root, stat.S_ISDIR)


def prefix_of(root):
    """Return the prefix of the names of a run's shared memory segments."""
    return f"hyp_{os.getuid()}_{Path(root).name}_"


def own_segments(folder, prefix):
    """Return this user's files in `folder` whose names begin with `prefix`, which is taken literally."""
    paths = [Path(entry.path) for entry in os.scandir(folder) if entry.name.startswith(prefix)]
    return [path for path in paths if is_own(path, stat.S_ISREG)]


def read_own(path, limit):
    """Return the text of a regular file of this user with at most `limit` bytes.

    Raises:
        FileNotFoundError: There is none.
        ValueError: It is longer, or no text.
    """
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    with os.fdopen(file, "rb") as opened:
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode) or status.st_uid != os.getuid():
            raise FileNotFoundError(path)
        content = opened.read(limit + 1)
    if len(content) > limit:
        raise ValueError(f"it has more than {limit} bytes")
    return content.decode()
