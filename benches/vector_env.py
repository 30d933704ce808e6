"""Speed of Python's envs: against a run with the same work, and against Gymnasium's own vector envs over single ones.

    python benches/vector_env.py

Needs `pip install './python[gym]'`. Every line is the median of `--rounds` rounds, in which all take turns.
"""

import argparse
import json
import os
import statistics
import subprocess
import tempfile
import threading
import time
from pathlib import Path

import gymnasium
import numpy as np

import hypogeum

TASK = "RaiseCube"
PROGRAM = os.environ.get("HYPOGEUM", "hypogeum")


def of_env(make, n_envs, n_steps):
    """Return the env-steps per second of a vector env after its reset."""
    env = make()
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (n_steps, *env.action_space.shape)).astype(np.float32)
    for action in actions[:10]:
        env.step(action)
    start = time.perf_counter()
    for action in actions:
        env.step(action)
    elapsed = time.perf_counter() - start
    env.close()
    return n_envs * n_steps / elapsed


def of_run(policy, n_envs, n_episodes, serve=None):
    """Return the env-steps per second of a run that asks its policy at every step."""
    with tempfile.TemporaryDirectory() as folder:
        command = [PROGRAM, "run", "--policy", policy, "--tasks", TASK, "--episodes", str(n_episodes), "--execute", "1"]
        command += ["--envs", str(n_envs), "--renderer", "cpu", "--keep-actions=false", "--json", "--db", f"{folder}/results.db"]
        thread = threading.Thread(target=hypogeum.serve, args=(serve, "vector-env")) if serve else None
        if thread:
            thread.start()
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
        if thread:
            thread.join()
    return json.loads(done.stdout)["fps"]["env_steps_per_s"]


def random_actions(observation):
    """Return random actions, whatever the observation is."""
    return np.random.default_rng(0).uniform(-1, 1, (observation.n_envs, 1, observation.action_dim))


def ours(n_envs, images):
    return lambda: hypogeum.make_vec(TASK, n_envs, images=images, renderer="cpu")


def asynchronous(images):
    make = lambda: hypogeum.HypogeumEnv(TASK, images=images, renderer="cpu")  # noqa: E731
    return lambda: gymnasium.vector.AsyncVectorEnv([make] * 64, context="spawn")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    cases = {
        "images, VectorEnv of 64": lambda: of_env(ours(64, True), 64, 60),
        "images, run with 64 envs": lambda: of_run("mine=attach:vector-env", 64, 128, random_actions),
        "images, AsyncVectorEnv of 64": lambda: of_env(asynchronous(True), 64, 20),
        "states, VectorEnv of 64": lambda: of_env(ours(64, False), 64, 600),
        "states, VectorEnv of 1024": lambda: of_env(ours(1024, False), 1024, 60),
        "states, run with 64 envs": lambda: of_run("random", 64, 1000),
        "states, AsyncVectorEnv of 64": lambda: of_env(asynchronous(False), 64, 100),
    }
    results = {name: [] for name in cases}
    for _ in range(arguments.rounds):
        for name, case in cases.items():
            results[name].append(case())
    for name, speeds in results.items():
        print(f"{name:32} {statistics.median(speeds):8,.0f} env-steps/s  ({min(speeds):,.0f} to {max(speeds):,.0f})")


if __name__ == "__main__":
    main()
