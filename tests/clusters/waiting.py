"""Bounded waits, free ports, and the processes of a cluster. Everything here looks from outside."""

import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")
POLL_INTERVAL_S = 0.1
# Time between SIGTERM and SIGKILL, and from there to the end.
STOP_S = 5.0


def wait_for(what: str, condition: Callable[[], T], timeout_s: float) -> T:
    """Returns the first true value of `condition`, or fails with what was waited for."""
    end = time.monotonic() + timeout_s
    while not (value := condition()):
        if time.monotonic() > end:
            raise TimeoutError(f"waited {timeout_s:.0f} s for {what}")
        time.sleep(POLL_INTERVAL_S)
    return value


def free_ports(n: int) -> list[int]:
    """Returns `n` successive free ports of 127.0.0.1, below those that the kernel gives away by itself."""
    for first in range(20_000 + os.getpid() % 97 * 100, 32_000, n):
        sockets = [socket.socket() for _ in range(n)]
        try:
            for port, listener in enumerate(sockets, first):
                listener.bind(("127.0.0.1", port))
            return list(range(first, first + n))
        except OSError:
            continue
        finally:
            for listener in sockets:
                listener.close()
    raise OSError(f"no {n} successive ports are free")


def processes_with(*entries: str) -> list[int]:
    """Returns the processes whose environment has entries that begin like each of these, without this one."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            environment = b"\0" + (folder / "environ").read_bytes()
        except OSError:
            continue
        if all(b"\0" + entry.encode() in environment for entry in entries) and int(folder.name) != os.getpid():
            found.append(int(folder.name))
    return found


def send(pid: int, number: signal.Signals) -> None:
    """Sends a signal to a process that may have ended."""
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        pass


def stop_all_with(entry: str) -> None:
    """Ends the processes with this entry in their environment."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        for pid in processes_with(entry):
            send(pid, number)
        try:
            wait_for("the processes to end", lambda: not processes_with(entry), STOP_S)
            return
        except TimeoutError:
            continue
    raise TimeoutError(f"processes {processes_with(entry)} survive SIGKILL")


def segments() -> set[str]:
    """Returns the names of the segments of runs in shared memory."""
    return {path.name for path in Path("/dev/shm").glob("hyp_*")}


def output_of(command: list[str], env: Mapping[str, str] | None = None, timeout_s: float = 30.0) -> str:
    """Runs a command and returns its standard output. If it fails, so does the test, with both outputs."""
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=timeout_s, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, f"{' '.join(command)}: exit code {done.returncode}\n{done.stdout}{done.stderr}"
    return done.stdout
