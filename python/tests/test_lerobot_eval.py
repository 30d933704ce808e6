"""The env type `hypogeum` of LeRobot's evaluator. Needs LeRobot 0.6.1 and, for a run to compare with, HYPOGEUM."""

import json
import os
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

# Nothing here needs a hub, and waiting for one takes a minute.
os.environ.setdefault("HF_HUB_OFFLINE", "1")
torch = pytest.importorskip("torch")
pytest.importorskip("gymnasium")
pytest.importorskip("lerobot.envs.configs", exc_type=ImportError)
pytest.importorskip("hypogeum._native")

ROOT = Path(__file__).parents[2]
PLUGIN = ROOT / "python/lerobot_env_hypogeum"
sys.path.insert(0, str(PLUGIN))

from draccus.utils import ParsingError  # noqa: E402
from lerobot.envs import env_to_policy_features, preprocess_observation  # noqa: E402
from lerobot.processor import PolicyProcessorPipeline  # noqa: E402
from lerobot.scripts.lerobot_eval import rollout  # noqa: E402
from lerobot_env_hypogeum import HypogeumEnvConfig  # noqa: E402

from hypogeum import HypogeumVectorEnv  # noqa: E402
from hypogeum.lerobot import LeRobotPolicy  # noqa: E402

HYPOGEUM = os.environ.get("HYPOGEUM")
CHECKPOINT = ROOT / "checkpoints/act-all/single"
N_EPISODES = 4
LAST = torch.channels_last
# lerobot-eval, with a backbone that is narrower than torchvision's.
EVALUATE = """
import sys
from hypogeum.backbone import resnet18_of, width_of
from lerobot.scripts.lerobot_eval import main
with resnet18_of(width_of({checkpoint!r})):
    main()
"""


def make(n_envs=2, **fields):
    """Return a vector env of RaiseCube."""
    ((_, envs),) = HypogeumEnvConfig(threads=1, **fields).create_envs(n_envs, use_async_envs=True).items()
    return envs[0]


def plain(**options):
    return HypogeumVectorEnv("RaiseCube", 2, threads=1, images=False, **options)


def message(envs, raw):
    """Return the observation of a vector env as a host's policy reads it."""
    tensors = {name: torch.from_numpy(array) for name, array in raw.items()}
    return SimpleNamespace(instructions=envs.instructions, torch=lambda: tensors)


def test_inputs_are_those_of_the_host():
    envs, raw_envs = make(checkpoint=str(CHECKPOINT)), HypogeumVectorEnv("RaiseCube", 2, threads=1)
    found = preprocess_observation(envs.reset()[0])
    expected = LeRobotPolicy(CHECKPOINT).batch(message(raw_envs, raw_envs.reset()[0]), slice(None))
    assert expected.pop("task") == list(envs.call("task_description"))
    assert found.keys() == expected.keys()
    assert all(torch.equal(found[name], expected[name]) for name in expected)


def test_rollout_is_that_of_the_host(monkeypatch):
    torch.set_num_threads(1)
    host, n_rows = LeRobotPolicy(CHECKPOINT), 15
    raw_envs, is_over = HypogeumVectorEnv("RaiseCube", 1, threads=1, autoreset_mode="Disabled"), False
    raw, _ = raw_envs.reset()
    while not is_over:
        chunk = host.infer([host.preprocess(host.batch(message(raw_envs, raw), slice(None)))], [(0, 0)])
        raw, _, _, truncated, expected = raw_envs.step_chunk(chunk[:, :n_rows])
        is_over = truncated[0]

    network, identity = host.policy, PolicyProcessorPipeline(steps=[])
    network.config.n_action_steps = n_rows
    select = network.select_action

    def select_alike(batch):
        """Select an action from images whose channels are last in memory; those of others are rounded otherwise."""
        return select({name: x.to(memory_format=LAST) if "images" in name else x for name, x in batch.items()})

    monkeypatch.setattr(network, "select_action", select_alike)
    envs = make(1, checkpoint=str(CHECKPOINT))
    found = rollout(envs, network, identity, identity, host.preprocess, host.postprocess, seeds=[1000])
    assert found["success"].any() and expected["is_success"][0]
    assert envs.step(np.zeros((1, 7), np.float32))[4]["fingerprint"][0] == expected["fingerprint"][0]


@pytest.mark.parametrize("first", [0, 1000])
def test_batches_run_every_episode_once(first):
    envs, others = make(seed=7), plain(seed=7)
    for batch in range(3):
        seeds = list(range(first + 2 * batch, first + 2 * batch + 2))
        _, found = envs.reset(seed=seeds, options={"lerobot_new_rollout": True})
        _, expected = others.reset()
        assert found["episode"].tolist() == [2 * batch, 2 * batch + 1]
        assert found["seed"].tolist() == expected["seed"].tolist()


def test_ended_env_stays_until_reset():
    envs, others = make(), plain(autoreset_mode="Disabled")
    horizon, n_late = envs.call("_max_episode_steps")[0], 40
    actions = np.random.default_rng(0).uniform(-1, 1, (n_late + horizon, 2, 7)).astype(np.float32)
    envs.reset(seed=[0, 1])
    for row in actions[:n_late]:
        envs.step(row)
    envs.reset(seed=[0, 1], options={"reset_mask": np.array([False, True])})
    ends, frames = [], []
    for row in actions[n_late:]:
        observation, rewards, _, truncated, infos = envs.step(row)
        frames.append(observation["pixels"]["external1"][0].copy())
        ends.append((*truncated, "final_info" in infos, infos["fingerprint"][0] if truncated[0] else None))
        assert not rewards.any()
    end = horizon - n_late
    assert [it[:3] for it in (ends[end - 2], ends[end - 1], ends[end], ends[-1])] == [
        (False, False, False), (True, False, True), (True, False, False), (True, True, True),
    ]  # fmt: skip
    assert len({it[3] for it in ends[end - 1 :]}) == 1
    assert (np.array(frames[end:]) == frames[end - 1]).all() and (frames[end - 2] != frames[end - 1]).any()
    others.reset(options={"episode": [0, 1]})
    last, *_, expected = others.step_chunk(actions[n_late:].swapaxes(0, 1))
    assert infos["fingerprint"][1] == expected["fingerprint"][1]
    assert (observation["agent_pos"][1] == last["state"][1]).all()
    assert envs.call("render")[0].shape == (224, 224, 3)


@pytest.mark.parametrize(
    "fields, images, state, embedding",
    [
        ({"shrink": 2}, {"external1": 112, "external2": 112, "hand": 64}, 25, 64),
        (
            {"task": "DualArmLiftPot"},
            {"external1": 224, "external2": 224, "panda1_hand": 128, "panda2_hand": 128}, 64, 64,
        ),
        ({"protocol": "lerobot"}, {"external1_camera": 480, "external2_camera": 480, "hand_camera": 480}, 9, None),
    ],
)
def test_features_are_those_of_a_dataset(fields, images, state, embedding):
    config = HypogeumEnvConfig(threads=1, **fields)
    found = {name: feature.shape for name, feature in env_to_policy_features(config).items()}
    assert {name: shape[1] for name, shape in found.items() if "images" in name} == {
        f"observation.images.{name}": side for name, side in images.items()
    }
    assert found["observation.state"] == (state,) and found.get("observation.environment_state") == (
        embedding and (embedding,)
    )
    (suites,) = config.create_envs(1).values()
    observation, _ = suites[0].reset(seed=[1000])
    assert suites[0].observation_space.contains(observation)
    found.pop("action")
    assert {name: tuple(x.shape[1:]) for name, x in preprocess_observation(observation).items()} == found


@pytest.mark.parametrize(
    "fields, words",
    [
        ({"task": "RaiseCub"}, "unknown task 'RaiseCub'; did you mean RaiseCube?"),
        ({"perturbation": "MO-Colr"}, "unknown perturbation 'MO-Colr'; did you mean MO-Color"),
        ({"task": "OpenDrawer", "perturbation": "MO-Color"}, "MO-Color does not apply to OpenDrawer: the task has no"),
        ({"task": "DualArmLiftPot", "checkpoint": str(CHECKPOINT)}, "is for a single robot, and DualArmLiftPot is a"),
        ({"control_mode": "pd_joint_pos", "checkpoint": str(CHECKPOINT)}, "width 7, which does not match control mode"),
        ({"max_parallel_tasks": 2}, "max_parallel_tasks is 2, expected 1"),
        ({"shrink": 0}, "shrink is 0, expected a positive integer"),
    ],
)
def test_wrong_field_is_one_sentence(fields, words):
    with pytest.raises(ParsingError) as error:
        HypogeumEnvConfig(**fields)
    assert words in str(error.value) and "\n" not in str(error.value)


def test_feature_without_source_is_named(copy):
    settings = json.loads((copy / "config.json").read_text())
    settings["input_features"]["observation.images.wrist"] = settings["input_features"].pop("observation.images.hand")
    (copy / "config.json").write_text(json.dumps(settings))
    with pytest.raises(ParsingError, match="observation.images.wrist: there is no camera 'wrist' or 'wrist_camera'"):
        HypogeumEnvConfig(checkpoint=str(copy))
    (copy / "hypogeum.json").write_text(json.dumps({"mapping": {"observation.images.wrist": "hand_camera"}}))
    assert "observation.images.wrist" in HypogeumEnvConfig(checkpoint=str(copy), threads=1).features


def test_suites_are_conditions():
    config = HypogeumEnvConfig(task="RaiseCube,StackCube", perturbation="None,MO-Color+Camera-Pose", threads=1)
    names = ["RaiseCube", "RaiseCube_MO-Color+Camera-Pose", "StackCube", "StackCube_MO-Color+Camera-Pose"]
    assert list(config.create_envs(1)) == names


@pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")
def test_evaluation_succeeds_where_a_run_does(tmp_path):
    # The distribution as LeRobot looks for it, without installing it.
    (tmp_path / "lerobot_env_hypogeum-0.1.0.dist-info").mkdir()
    (tmp_path / "lerobot_env_hypogeum-0.1.0.dist-info/METADATA").write_text("Name: lerobot_env_hypogeum\n")
    paths = os.pathsep.join(map(str, [tmp_path, PLUGIN, ROOT / "python"]))
    line = [
        sys.executable, "-c", EVALUATE.format(checkpoint=str(CHECKPOINT)), f"--policy.path={CHECKPOINT}",
        "--policy.device=cpu", "--policy.n_action_steps=15", "--env.type=hypogeum", "--env.task=RaiseCube",
        "--env.end=success", f"--eval.n_episodes={N_EPISODES}", "--eval.batch_size=2", f"--output_dir={tmp_path}/out",
    ]  # fmt: skip
    env = {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"}
    subprocess.run(line, cwd=tmp_path, env=env, check=True, timeout=300, stderr=subprocess.DEVNULL)
    (found,) = json.loads((tmp_path / "out/eval_info.json").read_text())["per_task"]
    options = ["--tasks", "RaiseCube", "--episodes", str(N_EPISODES), "--execute", "15", "--end", "success"]
    policy = ["--policy", f"act=act:{CHECKPOINT}"]
    # Paths of sockets must be short.
    with tempfile.TemporaryDirectory(prefix="hyp") as runs:
        env["XDG_RUNTIME_DIR"] = runs
        line = [HYPOGEUM, "run", *policy, *options, "--db", "r.db"]
        subprocess.run(line, cwd=tmp_path, env=env, check=True, timeout=300)
    with sqlite3.connect(tmp_path / "r.db") as results:
        expected = [bool(it) for (it,) in results.execute("select success_once from episodes order by episode")]
    assert found["task_group"] == "RaiseCube"
    assert found["metrics"]["successes"] == expected
    assert 0 < sum(expected) < N_EPISODES
