"""Datasets recorded from envs, and their reading. Set HYPOGEUM to the binary."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

HYPOGEUM = os.environ.get("HYPOGEUM")
pytestmark = pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")
gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("pyarrow")

import hypogeum  # noqa: E402
from hypogeum.program import EvaluationError  # noqa: E402

LIMIT_S = 120
SEED = 1000
KILLED = """
import sys, time, hypogeum
env = hypogeum.make_vec("RaiseCube", 1, images=False, threads=1)
recording = hypogeum.record(env, sys.argv[1])
env.reset()
env.step_chunk(0 * env.single_action_space.sample() + [[[0.0] * 7] * 300])
env.step(env.action_space.sample())
print("recorded", flush=True)
time.sleep(60)
"""


def vector(n=1, **options):
    return hypogeum.make_vec("RaiseCube", n, images=False, seed=SEED, threads=1, **options)


def rows(env, seed, n_rows=30):
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.3, 0.3, (env.num_envs, n_rows, env.single_action_space.shape[0])).astype(np.float32)


def run_episode(env, n_rows=30):
    """Execute random chunks until the first env's episode ends; return those of the first env, and the last info."""
    executed = []
    while True:
        chunks = rows(env, len(executed), n_rows)
        *_, terminated, truncated, info = env.step_chunk(chunks)
        executed.append(chunks[0])
        if terminated[0] or truncated[0]:
            return np.concatenate(executed), info


def files(root):
    return {path.relative_to(root): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


def test_dataset_is_that_of_demos(tmp_path):
    """The same episodes make the same bytes."""
    command = [HYPOGEUM, "demos", "-o", tmp_path, "--tasks", "RaiseCube", "--episodes", "2", "--shrink", "2"]
    subprocess.run(command, check=True, timeout=LIMIT_S)
    demos = hypogeum.Demonstrations(tmp_path / "single", images=False)
    assert [it.task for it in demos] == ["RaiseCube"] * 2 and demos.settings["seed"] == SEED
    lines = [
        json.dumps({**{key: getattr(it, key) for key in ("task", "instruction", "episode", "fingerprint")},
                    "actions": it.actions.ravel().tolist()}) + "\n"
        for it in demos
    ]  # fmt: skip
    command = [HYPOGEUM, "record", "-o", tmp_path / "mine", "--seed", str(SEED), "--shrink", "2"]
    subprocess.run(command, input="".join(lines) + "{partial", text=True, check=True, timeout=LIMIT_S)
    mine, theirs = files(tmp_path / "mine"), files(tmp_path / "single")
    assert mine.keys() == theirs.keys()
    assert [name for name in mine if mine[name] != theirs[name]] == []


@pytest.mark.parametrize("mode", gymnasium.vector.AutoresetMode)
def test_every_finished_episode_is_recorded(tmp_path, mode):
    env = vector(2, autoreset_mode=mode, perturbation="MO-Color")
    with hypogeum.record(env, tmp_path / "set", shrink=4) as recording:
        env.reset()
        first, _ = run_episode(env)
        if mode == gymnasium.vector.AutoresetMode.DISABLED:
            env.reset()
        elif mode == gymnasium.vector.AutoresetMode.NEXT_STEP:
            env.step(rows(env, 0)[:, 0])
        second, _ = run_episode(env, 7)
        env.step_chunk(rows(env, 0)) if mode == gymnasium.vector.AutoresetMode.SAME_STEP else None
        assert recording.n_episodes == 4
    found = hypogeum.Demonstrations(tmp_path / "set")
    assert found.settings["perturbation"] == ["MoColor"] and found.settings["seed"] == SEED
    assert [it.episode for it in found] == [0, 1, 2, 3]
    for demonstration, executed in ((found[0], first), (found[2], second)):
        assert np.array_equal(demonstration.actions, executed[: len(demonstration)])
    assert found[0].observations["external1_camera"].shape == (len(found[0]), 56, 56, 3)
    replayed = subprocess.run([HYPOGEUM, "replay", tmp_path / "set"], capture_output=True, text=True, timeout=LIMIT_S)
    assert "4 of 4 episodes reproduce" in replayed.stderr


def test_observations_are_those_of_the_env(tmp_path):
    env = gymnasium.wrappers.TimeLimit(hypogeum.HypogeumEnv("DualArmPushBox", seed=SEED), 10**6)
    seen = []
    with hypogeum.record(env, tmp_path / "set", images="png"):
        observation, _ = env.reset(options={"episode": 5})
        is_over = False
        env.action_space.seed(0)
        while not is_over:
            seen.append(observation)
            observation, _, terminated, truncated, info = env.step(env.action_space.sample())
            is_over = terminated or truncated
    [found] = hypogeum.Demonstrations(tmp_path / "set", images=["external1_camera", "panda2_hand_camera"])
    assert (found.episode, found.fingerprint) == (5, info["fingerprint"]) and len(found) == len(seen)
    assert list(found.observations) == ["state", "external1_camera", "panda2_hand_camera"]
    for name, values in found.observations.items():
        assert np.array_equal(values, [it[name] for it in seen]), name


def test_recording_is_continued(tmp_path):
    for n in (1, 2):
        env = vector()
        with hypogeum.record(env, tmp_path / "set", shrink=8) as recording:
            env.reset()
            run_episode(env, 300)
            assert recording.n_episodes == n
        env.reset()
        run_episode(env, 300)
        assert recording.n_episodes == n
    assert [it.episode for it in hypogeum.Demonstrations(tmp_path / "set", images=False)] == [0, 1]


def test_episodes_without_success_or_start_are_left_out(tmp_path):
    env = vector(autoreset_mode="Disabled")
    with hypogeum.record(env, tmp_path / "success", keep="success_at_end") as recording:
        env.reset()
        run_episode(env, 300)
        assert recording.n_episodes == 0
    env.reset()
    env.step_chunk(rows(env, 0))
    with hypogeum.record(env, tmp_path / "all") as recording:
        run_episode(env, 300)
        env.reset()
        env.set_state(env.get_state())
        run_episode(env, 300)
        env.reset()
        env.step_chunk(rows(env, 0))
        env.reset()
        assert recording.n_episodes == 0


def test_errors_are_one_sentence(tmp_path):
    env = vector()
    with pytest.raises(ValueError, match="^keep: expected one of all, success_once, success_at_end, found 'won'$"):
        hypogeum.record(env, tmp_path / "set", keep="won")
    with pytest.raises(TypeError, match="the env is a CartPoleEnv, expected a HypogeumEnv"):
        hypogeum.record(gymnasium.make("CartPole-v1"), tmp_path / "set")
    with pytest.raises(ValueError, match="one perturbation, and the env runs MO-Color, None"):
        hypogeum.record(vector(perturbation=["None", "MO-Color"], n=2), tmp_path / "set")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes").write_text("")
    with pytest.raises(EvaluationError, match="mine is not empty and contains no dataset"):
        hypogeum.record(env, tmp_path / "mine")
    with pytest.raises(FileNotFoundError, match="mine has no meta/info.json"):
        hypogeum.Demonstrations(tmp_path / "mine")
    with hypogeum.record(env, tmp_path / "set"):
        with pytest.raises(ValueError, match="recorded already"):
            hypogeum.record(env, tmp_path / "other")
        with pytest.raises(ValueError, match="seed: the dataset has episodes of suite seed 1000, found 3"):
            env.reset(seed=3)
    with pytest.raises(EvaluationError, match="shrink is 1 in the dataset, but 2"):
        hypogeum.record(vector(), tmp_path / "set", shrink=2)


def test_program_that_dies_is_reported(tmp_path):
    env = vector()
    recording = hypogeum.record(env, tmp_path / "set")
    os.kill(recording._child.pid, signal.SIGKILL)
    recording._child.wait(LIMIT_S)
    env.reset()
    with pytest.raises(EvaluationError, match="exit code -9"):
        run_episode(env, 300)
    recording.close()
    env.reset()


def test_dataset_of_a_killed_process_is_complete(tmp_path):
    command = [sys.executable, "-c", KILLED, tmp_path / "set"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "recorded\n"
        process.kill()
    end = time.monotonic() + LIMIT_S
    while not (tmp_path / "set/meta/tasks.parquet").exists() and time.monotonic() < end:
        time.sleep(0.05)
    [found] = hypogeum.Demonstrations(tmp_path / "set")
    assert not found.actions.any()


def test_lerobot_reads_a_recording(tmp_path):
    lerobot = pytest.importorskip("lerobot.datasets.lerobot_dataset", exc_type=ImportError)
    env = vector()
    with hypogeum.record(env, tmp_path / "set", shrink=2):
        env.reset()
        run_episode(env, 300)
    dataset = lerobot.LeRobotDataset("mine/set", root=tmp_path / "set")
    [found] = hypogeum.Demonstrations(tmp_path / "set")
    assert dataset.fps == 20 and len(dataset) == len(found) and dataset[3]["task"] == found.instruction
    assert np.array_equal(dataset[3]["action"], found.actions[3])
    image = dataset[3]["observation.images.hand"].permute(1, 2, 0) * 255
    assert np.array_equal(image.round().byte(), found.observations["hand_camera"][3])
