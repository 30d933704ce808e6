"""Envs in this process. Those that compare with runs need HYPOGEUM, the path of the `hypogeum` binary."""

import multiprocessing
import os
import sqlite3
import subprocess
import threading

import numpy as np
import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("hypogeum._native")
import gymnasium
from gymnasium.utils.env_checker import check_env

import hypogeum
from hypogeum.envs.conditions import TASKS

HYPOGEUM = os.environ.get("HYPOGEUM")
needs_program = pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")
PERTURBATIONS = ["None", "Distractor-Objects+Language-Other-Task"]
LIMIT_S = 120


def run(tmp_path, *arguments):
    """Run the program; return the rows of its results file."""
    file = tmp_path / "results.db"
    command = [HYPOGEUM, "run", "--db", str(file), "--envs", "8", "--threads", "2", *arguments]
    subprocess.run(command, check=True, capture_output=True, timeout=LIMIT_S)
    with sqlite3.connect(file) as database:
        database.row_factory = sqlite3.Row
        return {(row["task"], row["perturbation"], row["episode"]): row for row in database.execute("SELECT * FROM episodes")}


def actions_of(row, action_dim):
    """Return the executed rows of a stored episode, `[steps, action_dim]`."""
    return np.frombuffer(row["actions"][:-8], "<f4").reshape(-1, action_dim)


def random_actions(env, n, seed=0):
    """Return `n` actions for each env, `[num_envs, n, action_dim]`."""
    shape = (env.num_envs, n, env.single_action_space.shape[0])
    return np.random.default_rng(seed).uniform(-1, 1, shape).astype(np.float32)


def final_infos(env, actions):
    """Step all envs to their end, each with rows of its own; return the info of each at its end."""
    finals = [None] * env.num_envs
    for step in range(max(map(len, actions))):
        rows = np.stack([each[min(step, len(each) - 1)] for each in actions])
        _, _, terminated, truncated, infos = env.step(rows)
        for i in np.flatnonzero(terminated | truncated):
            if finals[i] is None:
                finals[i] = {key: infos[key][i] for key in infos if not key.startswith("_")}
    return finals


@needs_program
@pytest.mark.parametrize("morphology", ["single", "bimanual"])
def test_actions_of_a_run_give_its_fingerprints(tmp_path, morphology):
    tasks = [name for name, task in TASKS.items() if task["morphology"] == morphology]
    rows = run(
        tmp_path, "--policy", "random", "--tasks", ",".join(tasks), "--perturbations", ",".join(PERTURBATIONS),
        "--episodes", "1", "--execute", "10",
    )  # fmt: skip
    env = hypogeum.make_vec(tasks, perturbation=PERTURBATIONS, images=False)
    assert env.num_envs == len(rows) == 2 * len(tasks)
    env.reset(seed=0)
    expected = [rows[(*condition, 0)] for condition in env.env_conditions]
    actions = [actions_of(row, env.single_action_space.shape[0]) for row in expected]
    for row, final in zip(expected, final_infos(env, actions), strict=True):
        for key in ["task", "perturbation", "episode", "seed", "steps", "fingerprint", "success_at_end"]:
            assert final[key] == row[key], (key, row["task"], row["perturbation"])
        assert final["is_success"] == row["success_once"]
        assert final["failed_predicate"] == (row["failed_predicate"] or "")


@needs_program
def test_policy_host_sees_the_same_images(tmp_path):
    seen = []

    def zeros(observation):
        env = observation[0]
        seen.append((env.state.copy(), {name: image.copy() for name, image in env.cameras.items()}, env.instruction))
        return np.zeros((observation.n_envs, 10, observation.action_dim), np.float32)

    host = threading.Thread(target=hypogeum.serve, args=(zeros, "vector-images"), kwargs={"timeout_s": 60})
    host.start()
    run(
        tmp_path, "--policy", "mine=attach:vector-images", "--tasks", "RaiseCube", "--perturbations", "MO-Texture",
        "--episodes", "1", "--execute", "10", "--renderer", "cpu", "--seed", "3",
    )  # fmt: skip
    host.join(LIMIT_S)
    env = hypogeum.make_vec("RaiseCube", perturbation="MO-Texture", renderer="cpu")
    observation, _ = env.reset(seed=3)
    for state, images, instruction in seen[:3]:
        assert np.array_equal(observation["state"][0], state)
        assert all(np.array_equal(observation[name][0], image) for name, image in images.items())
        assert env.instructions == [instruction]
        observation, *_ = env.step_chunk(np.zeros((1, 10, 7), np.float32))


def test_gymnasium_accepts_the_env():
    env = gymnasium.make("hypogeum/RaiseCube", render_mode="rgb_array", image_size="64x64")
    check_env(env.unwrapped)
    env = gymnasium.make_vec("hypogeum/DualArmLiftPot", num_envs=2, images=False, autoreset_mode="SameStep")
    assert env.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.SAME_STEP
    observation, _ = env.reset()
    assert env.observation_space.contains(observation) and observation["state"].shape == (2, 64)


def test_episodes_do_not_depend_on_the_number_of_envs():
    def fingerprints(num_envs):
        env = hypogeum.make_vec("OpenDrawer", num_envs, images=False, end="success", autoreset_mode="SameStep")
        env.reset(seed=5)
        found = {}
        while len(found) < 4:
            row = np.zeros((num_envs, 50, 7), np.float32)
            infos = env.step_chunk(row)[4]
            for i in np.flatnonzero(infos.get("_final_info", [])):
                final = infos["final_info"]
                found[int(final["episode"][i])] = final["fingerprint"][i]
        return [found[i] for i in range(4)]

    assert fingerprints(1) == fingerprints(3)


def test_chunk_equals_its_rows():
    by_row, by_chunk = (hypogeum.make_vec("RaiseCube", 3, images=False) for _ in range(2))
    actions = random_actions(by_row, 12)
    for env in (by_row, by_chunk):
        env.reset(seed=1)
    for step in range(12):
        observation = by_row.step(actions[:, step])[0]
    assert np.array_equal(by_chunk.step_chunk(actions)[0]["state"], observation["state"])


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_episodes_follow_each_other_in_every_mode(mode):
    env = hypogeum.make_vec("RaiseCube", 2, images=False, autoreset_mode=mode, copy=True)
    start, infos = env.reset(seed=0)
    assert list(infos["episode"]) == [0, 1]
    horizon = TASKS["RaiseCube"]["max_steps"]
    rows = np.zeros((2, horizon, 7), np.float32)
    observation, rewards, terminated, truncated, infos = env.step_chunk(rows)
    assert truncated.all() and not terminated.any() and not rewards.any()
    final = infos["final_info"] if mode == "SameStep" else infos
    assert list(final["episode"]) == [0, 1] and list(final["steps"]) == [horizon] * 2
    last = infos["final_obs"][1]["state"] if mode == "SameStep" else observation["state"][1]
    if mode == "NextStep":
        observation, rewards, _, truncated, infos = env.step(rows[:, 0])
        assert not truncated.any() and not rewards.any()
    elif mode == "Disabled":
        with pytest.raises(RuntimeError, match="env 0 has ended"):
            env.step(rows[:, 0])
        observation, infos = env.reset(options={"reset_mask": np.array([False, True])})
        assert np.array_equal(infos["_episode"], [False, True]) and infos["episode"][1] == 2
        return
    assert list(infos["episode"]) == [2, 3]
    assert not np.array_equal(observation["state"][1], last)
    again, _ = env.reset(options={"episode": 0})
    assert np.array_equal(again["state"], start["state"])
    third, _ = env.reset(options={"episode": [3, 0]})
    assert np.array_equal(third["state"][1], start["state"][0])


def test_buffers_are_used_in_turn():
    env = hypogeum.make_vec("RaiseCube", 2, images=["hand_camera"], image_size="64x64", threads=1)
    first, _ = env.reset(seed=0)
    assert set(first) == {"state", "hand_camera"}
    before = {name: array.copy() for name, array in first.items()}
    rows = np.ones((2, 7), np.float32)
    second = env.step(rows)[0]
    assert all(np.array_equal(first[name], before[name]) for name in first)
    third = env.step(rows)[0]
    assert all(third[name] is first[name] and third[name] is not second[name] for name in first)
    assert not np.array_equal(first["state"], before["state"])
    env.close()
    assert first["state"].shape == (2, 25)


def test_states_can_be_set():
    env = hypogeum.make_vec("PegInsertionSide", 2, images=False)
    env.reset(seed=0, options={"episode": [7, 7]})
    env.step_chunk(random_actions(env, 5))
    states = env.get_state()
    assert states[0]["task"] == "PegInsertionSide" and states[0] != states[1]
    observation = env.set_state(states[1])
    assert np.array_equal(observation["state"][0], observation["state"][1])
    env.set_state([None, {**states[1], "arms": [{key: np.array(it) for key, it in states[1]["arms"][0].items()}]}])
    rows = np.repeat(random_actions(env, 5)[:1], 2, axis=0)
    observation = env.step_chunk(rows)[0]
    assert np.array_equal(observation["state"][0], observation["state"][1])
    for key, value, message in [
        ("task", "RaiseCube", "episode of PegInsertionSide"),
        ("sizes", [1.0], "sizes"),
        ("arms", [{"qpos": [9.0] * 9}], "arms.0..qpos.0.: expected numbers from"),
        ("bodies", {}, "expected a pose, found nothing"),
        ("colour", 1, "unknown field `colour`"),
        ("arms", [{"qpos": [float("nan")] * 9}], "not JSON compliant"),
    ]:
        with pytest.raises(ValueError, match=message):
            env.set_state({**states[0], key: value})
    with pytest.raises(ValueError, match="expected 2, found 1"):
        env.set_state([states[0]])


def test_reward_of_an_episode_is_its_success():
    env = hypogeum.make_vec("OpenDrawer", 1, images=False, end="success")
    env.reset(seed=0)
    state = env.get_state()[0]
    drawer = next(name for name in state["bodies"] if "drawer" in name)
    x, y, *rest = state["bodies"][drawer]["pose"]
    total, terminated = 0.0, np.array([False])
    for shift in [0.2, -0.2]:
        for axis in [0, 1]:
            pose = [x + shift * (axis == 0), y + shift * (axis == 1), *rest]
            env.set_state({**state, "bodies": {**state["bodies"], drawer: {"pose": pose}}})
            _, rewards, terminated, truncated, infos = env.step(np.zeros((1, 7), np.float32))
            if terminated[0]:
                assert rewards[0] == 1 and not truncated[0] and infos["is_success"][0]
                assert infos["first_success_step"][0] == 1
                return
            assert rewards[0] == 0
    pytest.fail("no direction opens the drawer")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tasks": "RaisCube"}, "unknown task 'RaisCube'; did you mean RaiseCube"),
        ({"tasks": []}, "expected a name or names"),
        ({"tasks": ["RaiseCube", "DualArmLiftPot"]}, "make one vector env for each"),
        ({"perturbation": "MO-Colour"}, "did you mean MO-Color"),
        ({"num_envs": 0}, "expected a positive integer, found 0"),
        ({"num_envs": True}, "expected a positive integer, found True"),
        ({"images": ["side"]}, "known are external1_camera"),
        ({"protocol": "colosseum"}, "'colosseum' for '--protocol"),
        ({"image_size": "3x3"}, "expected 64x64 to 1280x960"),
        ({"strength": 2}, "--strength"),
        ({"threads": 0}, "--threads"),
        ({"seed": -1}, "seed: expected an integer from 0 to"),
        ({"seed": 2**64}, "seed: expected an integer from 0 to"),
        ({"language": "/nowhere.yaml"}, "/nowhere.yaml"),
        ({"render_mode": "human"}, "found 'human'"),
        ({"tasks": "DualArmLiftPot", "control_mode": "pd_ee_pose"}, "bimanual robots use pd_joint_pos"),
    ],
)
def test_wrong_options_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        hypogeum.make_vec(**{"tasks": "RaiseCube", "num_envs": 1, **options})


def test_wrong_calls_are_named():
    env = hypogeum.make_vec("OpenDrawer", 2, perturbation="RO-Color", images=False)
    with pytest.raises(ValueError, match="RO-Color does not apply to OpenDrawer"):
        env.reset()
    env = hypogeum.make_vec("OpenDrawer", 2, images=False)
    row = np.zeros((2, 7), np.float32)
    with pytest.raises(RuntimeError, match="env 0 has no episode yet"):
        env.step(row)
    env.reset()
    for actions, error, message in [
        (row[:, :6], ValueError, r"shape \[2, 6\], expected \[2, 7\]"),
        (row[0], ValueError, r"shape \[7\], expected \[2, 7\]"),
        (row.astype(int), TypeError, "int64, expected float32"),
        (row.astype(object), TypeError, "object, expected float32"),
        (np.where(np.arange(14).reshape(2, 7) == 9, np.nan, row), ValueError, "env 1 is NaN in row 0, entry 2"),
        (np.full((2, 7), 1e300), ValueError, "env 0 is inf"),
    ]:
        with pytest.raises(error, match=message):
            env.step(actions)
    with pytest.raises(ValueError, match="expected .2, rows, 7"):
        env.step_chunk(row)
    with pytest.raises(ValueError, match="at least one row"):
        env.step_chunk(row[:, None][:, :0])
    for options, message in [
        ({"episodes": 1}, "'episodes'"),
        ({"episode": -1}, "found -1"),
        ({"episode": 2**32}, "found 4294967296"),
        ({"episode": [1]}, "found 1"),
        ({"reset_mask": [1, 0]}, "expected 2 bool"),
    ]:
        with pytest.raises(ValueError, match=message):
            env.reset(options=options)
    for num_envs, size in [(10**15, None), (10**5, "1280x960")]:
        with pytest.raises(MemoryError, match="MiB are available"):
            hypogeum.make_vec("RaiseCube", num_envs, image_size=size)
    env.close()
    env.close()
    with pytest.raises(RuntimeError, match="closed"):
        env.step(row)


def test_fork_is_refused():
    env = hypogeum.make_vec("RaiseCube", 1, images=False)
    env.reset()
    receiver, sender = multiprocessing.Pipe()

    def child():
        try:
            env.step(np.zeros((1, 7), np.float32))
        except RuntimeError as error:
            sender.send(str(error))

    process = multiprocessing.get_context("fork").Process(target=child)
    process.start()
    assert receiver.poll(30) and "made in another process" in receiver.recv()
    process.join(30)


def test_second_thread_is_refused():
    env = hypogeum.make_vec("RaiseCube", 256, images=False, threads=1)
    env.reset()
    rows = random_actions(env, 100)
    thread = threading.Thread(target=env.step_chunk, args=(rows,))
    thread.start()
    refused = False
    while thread.is_alive() and not refused:
        try:
            env.get_state()
        except RuntimeError as error:
            refused = "another thread" in str(error)
    thread.join(LIMIT_S)
    assert refused
    env.step(rows[:, 0])


def test_tensors_share_the_buffers():
    torch = pytest.importorskip("torch")
    env = hypogeum.make_vec("RaiseCube", 2, image_size="64x64")
    observation, _ = env.reset()
    for array in observation.values():
        assert torch.from_dlpack(array).data_ptr() == array.ctypes.data
