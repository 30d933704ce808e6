"""Recording of episodes as datasets that LeRobot trains on. The program repeats and renders them, and writes."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from . import _native
from .envs import HypogeumEnv, HypogeumVectorEnv
from .envs.conditions import TASKS
from .program import EvaluationError, find_program, message

# Time in which the program writes what it has got: at most three episodes per thread, and the statistics.
CLOSE_S = 600.0
# What `keep` accepts: whether an episode is kept, by the information on its end.
KEEP: dict[str, Callable[[dict[str, Any]], bool]] = {
    "all": lambda info: True,
    "success_once": lambda info: info["is_success"],
    "success_at_end": lambda info: info["success_at_end"],
}


def record(
    env: gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any],
    path: str | os.PathLike[str],
    *,
    keep: str = "all",
    images: str = "jpeg",
    shrink: int = 1,
    program: str | os.PathLike[str] | None = None,
) -> Recording:
    """Record every episode that ends in an env, until the returned `Recording` is closed.

    The dataset is like one of `hypogeum demos`, and has its images even if the env has none: only actions are kept
    here. A dataset that exists is continued: the next episode of each task is the one after the last in the dataset.
    An episode is left out if it is not finished, failed with an error, or began before the recording or by
    `set_state`.

    Args:
        env: A `HypogeumEnv` or `HypogeumVectorEnv`, also one inside wrappers of Gymnasium. A dataset has one
            perturbation and one suite seed. Use another seed than for evaluation, where 0 is the default:
            `hypogeum demos` uses 1000.
        path: Folder of the dataset.
        keep: `"all"`, `"success_once"` for episodes that reached the goal after any step, or `"success_at_end"`.
        images: `"jpeg"` or `"png"`.
        shrink: Factor by which images are downscaled.
        program: Path of the program, if it is not found by itself (see `hypogeum.program.find_program`).

    Raises:
        TypeError: The env is another one.
        ValueError: It runs several perturbations, is being recorded, or `keep` is unknown.
        EvaluationError: The program is missing, or refuses the folder or an option.
    """
    if keep not in KEEP:
        raise ValueError(f"keep: expected one of {', '.join(KEEP)}, found {keep!r}")
    base = env.unwrapped
    vector = base._vector if isinstance(base, HypogeumEnv) else base
    if not isinstance(vector, HypogeumVectorEnv):
        raise TypeError(f"the env is a {type(vector).__name__}, expected a HypogeumEnv or HypogeumVectorEnv")
    perturbations = sorted({it.perturbation for it in vector.env_conditions})
    if len(perturbations) > 1:
        raise ValueError(f"a dataset has one perturbation, and the env runs {', '.join(perturbations)}")
    if isinstance(vector._open(), _Recorder):
        raise ValueError("the env is being recorded already")
    words = [find_program(program), "record", f"--output={os.fspath(path)}", "--perturbation", perturbations[0]]
    words += ["--seed", str(vector._seed), "--images", images, "--shrink", str(shrink), *vector._words]
    if TASKS[vector.env_conditions[0].task]["morphology"] == "bimanual":
        words.append("--bimanual")
    return Recording(vector, keep, words)


class Recording:
    """A recording in progress, to be closed, or used as a context.

    Attributes:
        n_episodes: Number of episodes in the dataset, those that the program is still writing included.
    """

    def __init__(self, vector: HypogeumVectorEnv, keep: str, words: Sequence[str]) -> None:
        """See `record`."""
        self._vector, self._keep, self._seed = vector, KEEP[keep], vector._seed
        self._errors = tempfile.TemporaryFile("w+", errors="replace")
        # In a session of its own, it does not see the terminal's Ctrl-C, and writes what it has got.
        self._child = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors, text=True, start_new_session=True
        )
        assert self._child.stdout is not None
        with self._child.stdout as answer:
            line = answer.readline()
        if not line:
            self._finish()
        found = json.loads(line)
        self.n_episodes: int = found["episodes"]
        for condition in vector.env_conditions:
            after = max(vector._next_episode[condition], found["next"][condition.task])
            vector._next_episode[condition] = after
        vector._native = _Recorder(vector._open(), self, vector.num_envs)  # type: ignore[assignment]

    def close(self) -> None:
        """Stop recording and wait until the dataset is complete.

        Raises:
            EvaluationError: The program failed. The dataset has the episodes before.
        """
        recorder = self._vector._native
        if isinstance(recorder, _Recorder) and recorder._recording is self:
            self._vector._native = recorder._native
        self._finish()

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _add(self, info: dict[str, Any], actions: NDArray[np.float32]) -> None:
        if info["error"] is not None or not self._keep(info) or len(actions) < info["steps"]:
            return
        episode = {key: info[key] for key in ("task", "instruction", "episode", "fingerprint")}
        episode["actions"] = actions[: info["steps"]].ravel().tolist()
        self._write(json.dumps(episode))
        self.n_episodes += 1

    def _write(self, line: str) -> None:
        assert self._child.stdin is not None
        try:
            self._child.stdin.write(line + "\n")
            self._child.stdin.flush()
        except BrokenPipeError:
            self.close()

    def _finish(self) -> None:
        """Wait for the end of the program."""
        pipe = self._child.stdin
        if pipe is None or pipe.closed:
            return
        try:
            # An empty line ends the episodes, also if a process that was forked meanwhile holds the pipe.
            pipe.write("\n")
            pipe.close()
        except BrokenPipeError:
            pass
        try:
            code = self._child.wait(CLOSE_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            code = self._child.wait()
        with self._errors as errors:
            errors.seek(0)
            if code != 0:
                raise EvaluationError(message(errors, code))


class _Recorder:
    """A simulator that remembers the actions of each env's episode and hands them over at its end."""

    def __init__(self, native: _native.Simulator, recording: Recording, n_envs: int) -> None:
        self._native, self._recording = native, recording
        # Chunks of the episode; `None` if it is not recorded.
        self._chunks: list[list[NDArray[np.float32]] | None] = [None] * n_envs

    def __getattr__(self, name: str) -> Any:
        return getattr(self._native, name)

    def reset(self, starts: list[tuple[int, str, str, int]], seed: int) -> None:
        if seed != self._recording._seed:
            raise ValueError(
                f"seed: the dataset has episodes of suite seed {self._recording._seed}, found {seed}; record it in "
                "another folder"
            )
        self._native.reset(starts, seed)
        for env, *_ in starts:
            self._chunks[env] = []

    def set_state(self, env: int, state: str) -> None:
        self._native.set_state(env, state)
        self._chunks[env] = None

    def step(self, envs: NDArray[np.bool_], actions: NDArray[np.float32]) -> None:
        self._native.step(envs, actions)
        _, is_over, _ = self._native.progress()
        for env in map(int, np.flatnonzero(envs)):
            chunks = self._chunks[env]
            if chunks is None:
                continue
            chunks.append(actions[env].copy())
            if is_over[env]:
                self._chunks[env] = None
                self._recording._add(self._native.info(env), np.concatenate(chunks))
