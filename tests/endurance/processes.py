"""Processes of a run and their traces in the file system, as seen from outside. Used by kills.py and soak.py.

Every process of a run inherits one environment variable, by which it is found even after its parent is gone.
"""

import os
import re
import signal
from pathlib import Path

SHM = Path("/dev/shm")
PROC = Path("/proc")
# Environment variable whose value identifies the processes of one run.
TOKEN = "ENDURANCE_TOKEN"
# Start of the name of each segment of a run: `hyp_<uid>_<run>_`.
PREFIX = re.compile(r"hyp_\d+_[0-9a-f]{12}_")
# Roles by the first argument of a process.
COMMANDS = ("run", "fps", "report", "verify", "demos")
ROLES = {command: "orchestrator" for command in COMMANDS} | {"sim": "sim", "reap": "reaper", "-c": "host-python"}
# Lines of a kernel stack that a description shows per thread.
STACK_LINES = 6


def members(token: str) -> dict[int, str]:
    """Returns the roles of all processes with this token, by pid: `orchestrator`, `sim` or `host-NAME`."""
    wanted = f"{TOKEN}={token}".encode()
    found = {}
    for name in os.listdir(PROC):
        if name.isdecimal() and int(name) != os.getpid():
            try:
                # An exited process that nobody has waited for has no environment any more.
                if wanted in (PROC / name / "environ").read_bytes().split(b"\0"):
                    found[int(name)] = role((PROC / name / "cmdline").read_bytes())
            except OSError:
                pass
    return {pid: role for pid, role in found.items() if role}


def role(cmdline: bytes) -> str:
    """Returns the role of a process with this command line, or nothing if it has none."""
    words = cmdline.decode(errors="replace").split("\0")
    subcommand = words[1] if len(words) > 1 else ""
    policy = re.search(r'"policy":"([^"]*)"', words[3]) if subcommand == "policy-host" and len(words) > 3 else None
    return f"host-{policy[1]}" if policy else ROLES.get(subcommand, "")


def started(pid: int) -> str | None:
    """Returns the start time of a process, in ticks, or nothing if it has exited, even if nobody waited for it yet."""
    # The name of the program comes second, in parentheses, and may contain spaces.
    fields = _read(PROC / str(pid) / "stat").rpartition(")")[2].split()
    return fields[19] if len(fields) > 19 and fields[0] not in "ZX" else None


def kill(pid: int) -> bool:
    """Kills a process with SIGKILL. Returns `False` if it has exited before."""
    try:
        os.kill(pid, signal.SIGKILL)
        return True
    except ProcessLookupError:
        return False


def stop(pid: int):
    """Stops a process with SIGSTOP, if it exists."""
    try:
        os.kill(pid, signal.SIGSTOP)
    except ProcessLookupError:
        pass


def status(pid: int) -> dict[str, str]:
    """Returns the fields of `/proc/PID/status`, none if the process is gone."""
    try:
        lines = (PROC / str(pid) / "status").read_text().splitlines()
    except OSError:
        return {}
    return {key: value.strip() for key, _, value in (line.partition(":") for line in lines)}


def describe(pid: int) -> str:
    """Returns what each thread of a process is doing: its state, the kernel function it waits in and its stack."""
    text = [f"pid {pid}, {role(_read(PROC / str(pid) / 'cmdline').encode())}, {status(pid).get('State', 'gone')}"]
    for task in sorted((PROC / str(pid) / "task").glob("*")):
        stack = _read(task / "stack").splitlines()[:STACK_LINES]
        frames = " < ".join(line.split()[-1].split("+")[0] for line in stack if line.strip())
        text.append(f"  {_read(task / 'comm').strip()}: {_read(task / 'wchan')} {frames}")
    return "\n".join(text)


def segments(prefixes: set[str]) -> list[Path]:
    """Returns the files in shared memory whose names start with one of the prefixes."""
    return [SHM / name for name in sorted(os.listdir(SHM)) if any(name.startswith(prefix) for prefix in prefixes)]


def _read(path: Path) -> str:
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""
