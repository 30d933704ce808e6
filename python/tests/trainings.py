"""Running a training script in tests."""

import json
import signal
import subprocess
import time

LIMIT_S = 300


def log(output):
    """Return the rows of a training's log."""
    path = output / "training/log.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def run(command):
    """Train until the end."""
    subprocess.run(command, check=True, timeout=LIMIT_S)


def run_with_interruption(command, output, checkpoints):
    """Train until the end, interrupted after the first of so many checkpoints."""
    child = subprocess.Popen(command)
    deadline = time.monotonic() + LIMIT_S
    while not (output / "training/state.pt").exists() and child.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    child.send_signal(signal.SIGINT)
    child.wait(timeout=LIMIT_S)
    assert len(log(output)) < checkpoints, "training ended before it could be interrupted"
    run(command)
