"""Hypogeum as a benchmark of vla-eval's runner. Needs vla-eval 0.8 and gymnasium."""

import asyncio

import numpy as np
import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("vla_eval")
pytest.importorskip("hypogeum._native")

from policy_servers import N_ROWS, chunk, model_server
from vla_eval.api import run

from hypogeum import HypogeumEnv
from hypogeum.layout import MORPHOLOGIES
from hypogeum.vla_eval_benchmark import HypogeumBenchmark

NAME = "hypogeum.vla_eval_benchmark:HypogeumBenchmark"
# Number of steps of an episode here, for it to be short.
N_STEPS = 25


def evaluate(folder, server, n_episodes=2, **params):
    """Return the episodes of vla-eval's runner by task."""
    params = {"seed": 3, **params}
    entry = {"benchmark": NAME, "episodes_per_task": n_episodes, "max_steps": N_STEPS, "params": params}
    (result,) = run({"benchmarks": [entry]}, server_url=server.url, output_dir=folder, docker=False, no_save=True)
    return {task["task"]: task["episodes"] for task in result["tasks"]}


def fingerprint(env, episode):
    """Return that of an episode of the policy behind the server."""
    observation, info = env.reset(options={"episode": episode})
    while info["steps"] < N_STEPS:
        rows = chunk(observation["external1_camera"], observation["state"][:8], env.task_description)
        for row in rows[: N_STEPS - info["steps"]]:
            observation, *_, info = env.step(row)
    return info["fingerprint"]


def test_episodes_are_those_of_the_suite_seed(tmp_path):
    conditions = {"RaiseCube": "None", "RaiseCube_MO-Color": "MO-Color"}
    with model_server(chunk_size=N_ROWS) as server:
        found = evaluate(tmp_path, server, tasks="RaiseCube", perturbation=["None", "MO-Color"])
    assert list(found) == list(conditions)
    for name, perturbation in conditions.items():
        env = HypogeumEnv("RaiseCube", perturbation=perturbation, seed=3)
        expected = [fingerprint(env, episode) for episode in range(2)]
        assert [it["metrics"]["fingerprint"] for it in found[name]] == expected


def test_chunk_in_place_of_a_row_is_explained(tmp_path):
    with model_server() as server:
        (episode,) = evaluate(tmp_path, server, 1, tasks="RaiseCube")["RaiseCube"]
    assert episode["failure_reason"] == "env_step"
    assert f"answered actions [{N_ROWS}, 7], expected [7]; set chunk_size of the server" in episode["failure_detail"]


def test_wrong_names_are_refused():
    with pytest.raises(ValueError, match="unknown task 'RaiseCub'; did you mean RaiseCube?"):
        HypogeumBenchmark(tasks=["RaiseCub"])
    with pytest.raises(ValueError, match="unknown perturbation 'MO-Colr'"):
        HypogeumBenchmark("RaiseCube", "MO-Colr")


def test_tasks_of_both_robots_are_offered():
    benchmark = HypogeumBenchmark()
    names = [task["name"] for task in benchmark.get_tasks()]
    assert len(names) == len(set(names)) == 28 and {"RaiseCube", "DualArmLiftPot"} < set(names)


def test_bimanual_observation_has_all_cameras():
    benchmark = HypogeumBenchmark("DualArmLiftPot")
    (task,) = benchmark.get_tasks()
    asyncio.run(benchmark.start_episode(task))
    observation = asyncio.run(benchmark.get_observation())
    assert tuple(observation["images"]) == MORPHOLOGIES["bimanual"].cameras
    assert observation["state"].shape == (64,) and observation["task_description"]
    result = benchmark.step({"actions": np.zeros(16, np.float32)})
    assert (result.done, benchmark.get_step_result(result)["success"]) == (False, False)
    benchmark.cleanup()
