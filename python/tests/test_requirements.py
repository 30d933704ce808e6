"""Commands without torch, LeRobot or FFmpeg, which stand-ins for the packages replace."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hypogeum.requirements import explain

HERE = Path(__file__).parents[1]
COMMANDS = {
    "host": [sys.executable, "-m", "hypogeum.lerobot"],
    "act": [sys.executable, str(HERE / "train_act.py")],
    "pi05": [sys.executable, str(HERE / "train_pi05.py")],
}
NO_FFMPEG = "RuntimeError('Could not load libtorchcodec. Likely causes:\\n  1. FFmpeg is not properly installed')"


def run(tmp_path, command, *arguments, failure="ModuleNotFoundError(\"No module named 'torch'\", name='torch')"):
    (tmp_path / "torch.py").write_text(f"raise {failure}\n")
    # The training scripts import these before torch.
    for name in ("numpy", "sentencepiece"):
        if command != "host":
            (tmp_path / f"{name}.py").touch()
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(HERE)])}
    return subprocess.run([*COMMANDS[command], *arguments], capture_output=True, text=True, env=env, timeout=60)


def test_help_of_the_host_needs_no_torch(tmp_path):
    done = run(tmp_path, "host", "--help")
    assert done.returncode == 0 and "checkpoint saved by LeRobot" in done.stdout and done.stderr == ""
    done = run(tmp_path, "host", "mine", "folder", "--devise", "cpu")
    assert done.returncode == 2 and "unrecognized arguments: --devise cpu" in done.stderr


@pytest.mark.parametrize("command", COMMANDS)
def test_missing_package_is_one_sentence(tmp_path, command):
    done = run(tmp_path, command, "mine", "folder")
    assert done.returncode == 1 and done.stderr.count("\n") == 1, done.stderr
    for words in (
        "error: No module named 'torch'",
        "pip install",
        "[lerobot]" if command != "pi05" else "[pi]",
        "3.12",
    ):
        assert words in done.stderr


def test_missing_ffmpeg_is_one_sentence(tmp_path):
    done = run(tmp_path, "act", failure=NO_FFMPEG)
    assert done.returncode == 1 and done.stderr.count("\n") == 1 and "apt install ffmpeg" in done.stderr, done.stderr


def test_other_errors_are_not_explained():
    assert explain(RuntimeError("size mismatch"), "pip install x") is None
