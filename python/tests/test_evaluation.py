"""Evaluation of policies in this process. Set HYPOGEUM to the `hypogeum` binary."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

HYPOGEUM = os.environ.get("HYPOGEUM")
pytestmark = pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")

import hypogeum  # noqa: E402
from hypogeum.endpoint import base_folder  # noqa: E402

LIMIT_S = 60
SHORT = {"tasks": "RaiseCube", "episodes": 3, "options": ("--threads", "1"), "quiet": True}
FUNCTION = """
import sys, time
import numpy as np, hypogeum
calls = 0
def states(observation):
    global calls
    calls += 1
    {body}
    chunk = np.zeros((observation.n_envs, 10, observation.action_dim))
    chunk[:, :, :3] = observation.states[:, None, :3] * 0.1
    return chunk
"""


def function(body="pass"):
    """Return a policy function whose actions depend on what it sees."""
    names = {}
    exec(FUNCTION.format(body=body), names)
    return names["states"]


def shared_memory():
    return {name for name in os.listdir("/dev/shm") if name.startswith(f"hyp_{os.getuid()}_")}


@pytest.fixture(autouse=True)
def nothing_is_left():
    """Fail if a run leaves a file, or a process that holds one."""
    runs = set(base_folder().glob("*"))
    before = shared_memory()
    yield
    assert shared_memory() <= before and set(base_folder().glob("*")) <= runs


def fingerprints(results):
    return [(row["task"], row["episode"], row["fingerprint"], row["error"]) for row in results.episodes]


def children():
    """Return the processes that this one has started and that still run."""
    found = subprocess.run(["pgrep", "-P", str(os.getpid()), "hypogeum"], capture_output=True, text=True, check=False)
    return found.stdout.split()


def running(db):
    """Return the processes that have a results file among their arguments."""
    found = subprocess.run(["pgrep", "-f", str(db)], capture_output=True, text=True, check=False)
    return found.stdout.split()


def test_episodes_equal_those_of_a_host(tmp_path):
    results = hypogeum.evaluate(function(), **SHORT)
    db = tmp_path / "r.db"
    words = ["--policy", "p=attach:test-evaluation", "--tasks", "RaiseCube", "--episodes", "3", "--threads", "2"]
    run = subprocess.Popen([HYPOGEUM, "run", *words, "--db", db, "--quiet"], stdout=subprocess.DEVNULL)
    hypogeum.serve(function(), "test-evaluation", timeout_s=LIMIT_S)
    assert run.wait(LIMIT_S) == 0
    assert fingerprints(results) == fingerprints(hypogeum.Results(db))
    assert len({row["fingerprint"] for row in results.episodes}) == 3 and results.cells[0].errors == 0


def hold(observation):
    """Do what the built-in `idle` does, in the same precision."""
    low, high = np.float32(-0.01), np.float32(0.04)
    chunk = np.zeros((observation.n_envs, 30, observation.action_dim), np.float32)
    fingers = np.float32(0.5) * (observation.states[:, 7] + observation.states[:, 8])
    chunk[:, :, 6] = (np.float32(2) * (fingers - low) / (high - low) - np.float32(1)).clip(-1, 1)[:, None]
    return chunk


def test_function_equals_the_built_in_policy():
    idle = fingerprints(hypogeum.evaluate("idle", **SHORT))
    assert fingerprints(hypogeum.evaluate(hold, **SHORT)) == idle
    assert fingerprints(hypogeum.evaluate("random", **SHORT)) != idle


@pytest.mark.parametrize("error", ["KeyError('camera')", "TimeoutError('slow')", "KeyboardInterrupt()"])
def test_exception_of_the_policy_reaches_the_caller(error):
    expected = type(eval(error))
    with pytest.raises(expected) as caught:
        hypogeum.evaluate(function(f"if calls == 2: raise {error}"), **SHORT)
    assert caught.value.args == eval(error).args and not children()


def test_answer_of_wrong_shape_is_explained():
    with pytest.raises(hypogeum.AnswerError, match="action_dim=7"):
        hypogeum.evaluate(lambda observation: np.zeros((observation.n_envs, 1, 6)), **SHORT)


def test_action_that_is_not_finite_ends_its_episode():
    seeds = []

    def policy(observation):
        seeds.extend(env.policy_seed for env in observation)
        chunk = np.zeros((observation.n_envs, 1, observation.action_dim))
        chunk[[env.policy_seed == seeds[0] for env in observation]] = np.nan
        return chunk

    [cell] = hypogeum.evaluate(policy, **SHORT).cells
    assert (cell.n, cell.errors) == (2, 1)


def test_message_of_the_program_is_raised():
    for policy in ("idle", function()):
        with pytest.raises(hypogeum.EvaluationError, match="did you mean RaiseCube"):
            hypogeum.evaluate(policy, **SHORT | {"tasks": "RiseCube"})
    with pytest.raises(hypogeum.EvaluationError, match="act:nowhere|nowhere does not exist"):
        hypogeum.evaluate("act:nowhere", **SHORT)
    with pytest.raises(TypeError, match="type int"):
        hypogeum.evaluate(3, **SHORT)


def test_progress_goes_to_stderr(capsys):
    hypogeum.evaluate("idle", **SHORT | {"quiet": False})
    assert "of 3 episodes done" in capsys.readouterr().err
    hypogeum.evaluate("idle", **SHORT)
    assert capsys.readouterr() == ("", "")


def test_missing_program_is_explained(monkeypatch, tmp_path):
    with pytest.raises(hypogeum.EvaluationError, match="program is '/nowhere'"):
        hypogeum.evaluate("idle", program="/nowhere", **SHORT)
    monkeypatch.setenv("HYPOGEUM", "/nowhere/hypogeum")
    with pytest.raises(hypogeum.EvaluationError, match="HYPOGEUM is"):
        hypogeum.evaluate("idle", **SHORT)
    monkeypatch.delenv("HYPOGEUM")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("sysconfig.get_path", lambda _: str(tmp_path / "scripts"))
    monkeypatch.setattr("sys.executable", str(tmp_path / "bin/python"))
    with pytest.raises(hypogeum.EvaluationError, match="cargo build --release"):
        hypogeum.evaluate("idle", **SHORT)
    for folder in ("", "scripts", "bin"):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / "hypogeum").symlink_to(Path(HYPOGEUM).absolute())
        assert hypogeum.program.find_program() == str(tmp_path / folder / "hypogeum")


def test_stored_episodes_are_not_repeated(tmp_path):
    db = tmp_path / "r.db"
    first = fingerprints(hypogeum.evaluate(function(), db=db, **SHORT | {"episodes": 2}))
    calls = []

    def counted(observation, inner=function()):
        calls.append(min(env.query for env in observation))
        return inner(observation)

    second = hypogeum.evaluate(counted, db=db, **SHORT)
    assert fingerprints(second)[:2] == first and len(second.episodes) == 3
    assert fingerprints(second) == fingerprints(hypogeum.evaluate(function(), **SHORT))
    calls.clear()
    hypogeum.evaluate(counted, db=db, **SHORT)
    assert calls == []


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("delay_s", [0, 0.1, 1.5])
def test_killed_process_leaves_no_run(number, delay_s, tmp_path):
    script = FUNCTION.format(body="time.sleep(0.1)") + (
        "print('ready', flush=True)\n"
        "hypogeum.evaluate(states, 'RaiseCube', episodes=1000, options=('--threads', '1'), "
        f"db={str(tmp_path / 'r.db')!r})"
    )
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    child = subprocess.Popen([sys.executable, "-c", script], **pipes)
    assert child.stdout.readline() == "ready\n"
    time.sleep(delay_s)
    child.send_signal(number)
    child.communicate(timeout=LIMIT_S)
    assert child.returncode == -number
    deadline = time.monotonic() + LIMIT_S
    # The run has the path of its results in its arguments.
    while (left := running(tmp_path / "r.db")) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert left == []
