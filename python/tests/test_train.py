"""Training as the README tells it: set HYPOGEUM to the binary, and install lerobot[dataset]."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

HYPOGEUM = os.environ.get("HYPOGEUM")
pytestmark = pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM does not name the binary")
pytest.importorskip("lerobot.policies.act.modeling_act", exc_type=ImportError)
from hypogeum.lerobot import LeRobotPolicy  # noqa: E402

SCRIPT = Path(__file__).parents[1] / "train_act.py"
LIMIT_S = 300
SMALL = "--width 4 --shrink 4 --dim 32 --layers 1 --batch-size 4 --steps 40 --save-every 5 --threads 1".split()


@pytest.fixture(scope="module")
def demos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demos")
    command = [HYPOGEUM, "demos", "-o", folder, "--tasks", "RaiseCube,OpenDrawer", "--episodes", "2"]
    subprocess.run(command, check=True, timeout=LIMIT_S)
    return folder / "single"


def command(demos, output, *more):
    return [sys.executable, SCRIPT, demos, "-o", output, *SMALL, *more]


def log(output):
    path = output / "training/log.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def test_it_learns_goes_on_after_an_interruption_and_can_be_evaluated(demos, tmp_path):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    evaluated = command(demos, whole, "--tasks", "RaiseCube", "--evaluate", HYPOGEUM, "--episodes", "1")
    subprocess.run([*evaluated, "--save-every", "20"], check=True, timeout=LIMIT_S)
    rows = log(whole)
    assert [row["step"] for row in rows] == [20, 40] and rows[-1]["loss"] < 0.9 * rows[0]["loss"]
    assert all(list(row["success_once"]) == ["RaiseCube"] for row in rows)

    child = subprocess.Popen(command(demos, broken, "--tasks", "RaiseCube"))
    deadline = time.monotonic() + LIMIT_S
    while not (broken / "training/state.pt").exists() and child.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    child.send_signal(signal.SIGINT)
    child.wait(timeout=LIMIT_S)
    assert len(log(broken)) < 8, "it was over before it could be interrupted"
    subprocess.run(command(demos, broken, "--tasks", "RaiseCube"), check=True, timeout=LIMIT_S)
    weights = "model.safetensors"
    assert (whole / weights).read_bytes() == (broken / weights).read_bytes()

    # A ResNet of a width that LeRobot does not know is loaded all the same.
    policy = LeRobotPolicy(whole)
    inputs = policy.policy.config.input_features
    batch = {name: torch.zeros(1, *feature.shape) for name, feature in inputs.items()}
    chunk = policy.infer(batch | {"task": [""]})
    assert chunk.shape == (1, 30, 7) and np.isfinite(chunk).all() and chunk.std() > 0


@pytest.mark.parametrize(
    "more, words",
    [
        (["--tasks", "RaiseCube,StackCube"], ["has no episodes of StackCube"]),
        (["--dim", "64"], ["was made with dim 32, not 64"]),
        (["--tasks", "OpenDrawer"], ["was made of another dataset or other tasks"]),
    ],
)
def test_what_does_not_fit_is_refused(demos, tmp_path_factory, more, words):
    output = tmp_path_factory.getbasetemp() / "refusing"
    short = ["--steps", "1", "--save-every", "1"]
    if not output.exists():
        subprocess.run(command(demos, output, *short), check=True, timeout=LIMIT_S)
    done = subprocess.run(command(demos, output, *short, *more), capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode == 1 and all(word in done.stderr for word in words), done.stderr


def test_a_folder_without_demonstrations_is_named(tmp_path):
    nowhere = command(tmp_path / "nowhere", tmp_path / "out")
    done = subprocess.run(nowhere, capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode == 1 and "nowhere has no meta/hypogeum.jsonl" in done.stderr
