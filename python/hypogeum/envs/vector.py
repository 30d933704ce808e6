"""A vector env: many episodes side by side, stepped and rendered by the simulator in this process."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from .. import _native
from .conditions import TASKS, Condition, conditions, option_words
from .spaces import action_space, observation_space

Observation = dict[str, NDArray[Any]]
# Largest suite seed and index of an episode.
MAX_SEED, MAX_EPISODE = 2**64 - 1, 2**32 - 1


class EnvHandle:
    """One env of a vector env."""

    def __init__(self, vector: HypogeumVectorEnv, index: int):
        self._vector, self._index = vector, index

    @property
    def condition(self) -> Condition:
        """Task and perturbation."""
        return self._vector.env_conditions[self._index]

    @property
    def task(self) -> str:
        """Name of the task."""
        return self.condition.task

    @property
    def task_description(self) -> str:
        """Instruction of the current episode."""
        return self._vector.instructions[self._index]

    @property
    def _max_episode_steps(self) -> int:
        return int(TASKS[self.task]["max_steps"])

    def render(self) -> NDArray[np.uint8]:
        """Return the image of the first external camera."""
        frames = self._vector.frames(np.arange(self._vector.num_envs) == self._index)
        return np.asarray(frames[self._index])


class HypogeumVectorEnv(VectorEnv[Observation, ArrayLike, NDArray[Any]]):
    """Envs of one robot that run tasks under perturbations.

    Env `i` runs condition `i % len(conditions)`. The episodes of a condition are started in order, whatever `num_envs`
    is. An observation is a dict of arrays: `state`, `[num_envs, state_dim]` f32, and
    by the name of each camera `[num_envs, height, width, 3]` u8. They are the buffers into which the simulator
    renders. There are two sets, used in turn: what `step` returns stays as it is during the next `step` and shows
    newer data after the one that follows. `copy=True` returns copies instead.
    """

    def __init__(
        self,
        tasks: str | Sequence[str],
        num_envs: int | None = None,
        *,
        perturbation: str | Sequence[str] = "None",
        images: bool | Sequence[str] = True,
        seed: int = 0,
        protocol: str | None = None,
        control_mode: str | None = None,
        image_size: str | None = None,
        instructions: str | None = None,
        end: str | None = None,
        profile: str | None = None,
        strength: float | None = None,
        language: str | None = None,
        renderer: str | None = None,
        samples: int | None = None,
        gpu: int | None = None,
        threads: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        copy: bool = False,
    ):
        """See `hypogeum.make_vec`."""
        self._native: _native.Simulator | None = None
        self._conditions = conditions(tasks, perturbation)
        num_envs = len(self._conditions) if num_envs is None else num_envs
        if isinstance(num_envs, bool) or not isinstance(num_envs, (int, np.integer)) or num_envs < 1:
            raise ValueError(f"num_envs: expected a positive integer, found {num_envs!r}")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode: expected None or 'rgb_array', found {render_mode!r}")
        self.num_envs, self.render_mode, self._copy = int(num_envs), render_mode, copy
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {"autoreset_mode": self._mode, "render_modes": ["rgb_array"], "render_fps": 20}
        options = {
            "protocol": protocol, "control_mode": control_mode, "image_size": image_size,
            "instructions": instructions, "end": end, "profile": profile, "strength": strength,
            "language": language, "renderer": renderer, "samples": samples, "gpu": gpu, "threads": threads,
        }  # fmt: skip
        morphology = TASKS[self._conditions[0].task]["morphology"]
        with_images = images is not False or render_mode is not None
        self._words = option_words(options)
        native = _native.Simulator(self.num_envs, morphology, with_images, self._words)
        if control_mode not in (None, native.control_mode):
            raise ValueError(f"control_mode: {morphology} robots use {native.control_mode}, found {control_mode!r}")
        self._cameras = _select_cameras(native.cameras, images)
        self.control_mode = native.control_mode
        self._action_dim = native.action_dim
        self.single_observation_space = space = observation_space(native.state_dim, [it for _, it in self._cameras])
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.single_action_space = action_space(native.control_mode, native.action_dim)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.env_conditions = [self._conditions[i % len(self._conditions)] for i in range(self.num_envs)]
        self.envs = tuple(EnvHandle(self, i) for i in range(self.num_envs))
        self._seed = _index("seed", seed, MAX_SEED)
        self._next_episode: Counter[Condition] = Counter()
        self._instructions = [""] * self.num_envs
        self._was_successful = np.zeros(self.num_envs, bool)
        self._is_over = np.zeros(self.num_envs, bool)
        self._native = native
        self._shapes = {name: (self.num_envs, *(it.shape or ())) for name, it in space.items()}
        self._buffers = [self._new_buffers(), self._new_buffers()]

    @property
    def instructions(self) -> list[str]:
        """Instruction of the current episode of each env."""
        return list(self._instructions)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start the next episode in each env.

        Args:
            seed: Suite seed, as `--seed` of a run; episodes are counted from 0 again.
            options: `episode` is the index at which counting starts, or an index per env. `reset_mask`, `[num_envs]`
                bool, names the envs to reset; the others go on.

        Raises:
            ValueError: an option is unknown or has another form, or a perturbation does not apply.
        """
        native = self._open()
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        mask = np.ones(self.num_envs, bool) if mask is None else _mask(mask, self.num_envs)
        episode = options.pop("episode", None)
        if options:
            raise ValueError(f"options: expected episode and reset_mask, found {', '.join(map(repr, options))}")
        if seed is not None:
            self._seed = _index("seed", seed, MAX_SEED)
            self._next_episode.clear()
        if episode is not None and np.ndim(episode) == 0:
            first = _index("episode", episode, MAX_EPISODE)
            self._next_episode = Counter(dict.fromkeys(self._conditions, first))
            episode = None
        if episode is not None and len(episode) != self.num_envs:
            raise ValueError(f"episode: expected an index or {self.num_envs} of them, found {len(episode)}")
        self._start(native, mask, episode)
        return self._observe(native), self._infos(native, mask)

    def step(
        self, actions: ArrayLike
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Execute one action row, `[action_dim]` f32, in each env.

        The reward is 1 in the step in which a task first succeeds, so that the return of an episode is its success.
        `terminated` is true where the protocol ends an episode by its success, `truncated` at the horizon. `infos`
        has `is_success` (success up to now) of all envs. For episodes that have ended it has those of
        `final_info`, with `SAME_STEP`, or at the top level: `task`, `perturbation`, `episode`, `seed`,
        `instruction`, `steps`, `is_success`, `success_at_end`, `first_success_step` (-1 if none),
        `failed_predicate` and `error` (empty if none), and `fingerprint`, which equals that of a run with the same
        actions.

        Raises:
            ValueError: actions have another shape, or are not finite.
            TypeError: actions are not floating-point numbers.
            RuntimeError: an env has not been reset, is closed, or belongs to another process or thread.
        """
        return self.step_chunk(_actions(actions, (self.num_envs, self._action_dim))[:, None])

    def step_chunk(
        self, chunks: ArrayLike
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Execute the rows of an action chunk, `[num_envs, n_rows, action_dim]`, in each env, as a run does.

        Nothing is rendered between the rows. An episode that ends before the last row ignores the others.
        Otherwise like `step`.
        """
        native = self._open()
        chunks = _actions(chunks, (self.num_envs, None, self._action_dim))
        pending = self._is_over.copy()
        if self._mode is AutoresetMode.DISABLED and pending.any():
            env = int(np.argmax(pending))
            raise RuntimeError(f"the episode of env {env} has ended: reset it, with options={{'reset_mask': ...}}")
        native.step(~pending, chunks)
        if pending.any():
            self._start(native, pending, None)
        succeeded, is_over, is_won = native.progress()
        rewards = (succeeded & ~self._was_successful).astype(np.float64)
        terminated, truncated = is_won, is_over & ~is_won
        self._was_successful, self._is_over = succeeded.copy(), is_over.copy()
        final: dict[str, Any] = {}
        if self._mode is AutoresetMode.SAME_STEP and is_over.any():
            final = self._final(native, is_over)
            self._start(native, is_over, None)
        infos = self._infos(native, pending | is_over) | final
        infos["is_success"], infos["_is_success"] = succeeded, np.ones(self.num_envs, bool)
        return self._observe(native), rewards, terminated, truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return the image of the first external camera of each env, if `render_mode` is `rgb_array`."""
        if self.render_mode is None:
            return None
        return tuple(self.frames(np.ones(self.num_envs, bool)))

    def frames(self, envs: NDArray[np.bool_]) -> NDArray[np.uint8]:
        """Render the first external camera of some envs: `[num_envs, height, width, 3]` u8, 0 for the others."""
        native = self._open()
        _, height, width = native.cameras[0]
        frames = np.zeros((self.num_envs, height, width, 3), np.uint8)
        states = np.empty((self.num_envs, native.state_dim), np.float32)
        native.observe(envs, states, [(0, frames)])
        return frames

    def get_state(self) -> list[dict[str, Any]]:
        """Return the state of each env in the format of `hypogeum replay --start` (docs/trajectories.md)."""
        native = self._open()
        return [json.loads(native.state(env)) for env in range(self.num_envs)]

    def set_state(self, states: dict[str, Any] | Sequence[dict[str, Any] | None]) -> Observation:
        """Set the states of envs and return the new observations.

        Args:
            states: A state for all envs, or a list of one per env, with `None` for those that stay as they are. Only
                its arms and bodies are used. The episode restarts from there: at step 0, not yet successful, and with
                the fingerprint of a trajectory from that state.

        Raises:
            ValueError: a state belongs to another task, or has impossible values. Envs before it have been set.
        """
        native = self._open()
        each = [states] * self.num_envs if isinstance(states, dict) else list(states)
        if len(each) != self.num_envs:
            raise ValueError(f"states: expected {self.num_envs}, found {len(each)}")
        for env, state in enumerate(each):
            if state is not None:
                native.set_state(env, json.dumps(state, allow_nan=False, default=_plain))
                self._was_successful[env] = self._is_over[env] = False
        return self._observe(native)

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of each env, or get an attribute, as Gymnasium's own vector envs do."""
        found = [getattr(env, name) for env in self.envs]
        return tuple(it(*args, **kwargs) if callable(it) else it for it in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Get an attribute of each env."""
        return self.call(name)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the simulator and the buffers. Observations that are still held stay valid."""
        self._native, self._buffers = None, []

    def _open(self) -> _native.Simulator:
        if self._native is None:
            raise RuntimeError("the env is closed")
        return self._native

    def _new_buffers(self) -> Observation:
        types = {"state": np.float32}
        return {name: np.zeros(shape, types.get(name, np.uint8)) for name, shape in self._shapes.items()}

    def _start(self, native: _native.Simulator, mask: NDArray[np.bool_], episodes: Sequence[int] | None) -> None:
        starts = []
        counts = self._next_episode.copy()
        for env in map(int, np.flatnonzero(mask)):
            condition = self.env_conditions[env]
            if episodes is None:
                episode = counts[condition]
                counts[condition] += 1
            else:
                episode = _index("episode", episodes[env], MAX_EPISODE)
            starts.append((env, condition.task, condition.perturbation, episode))
        native.reset(starts, self._seed)
        self._next_episode = counts
        self._was_successful[mask] = self._is_over[mask] = False
        for env, *_ in starts:
            self._instructions[env] = native.info(env)["instruction"]

    def _observe(self, native: _native.Simulator) -> Observation:
        self._buffers.reverse()
        buffers = self._buffers[0]
        self._write(native, np.ones(self.num_envs, bool), buffers)
        return {name: array.copy() for name, array in buffers.items()} if self._copy else dict(buffers)

    def _write(self, native: _native.Simulator, mask: NDArray[np.bool_], buffers: Observation) -> None:
        images = [(index, buffers[name]) for index, (name, _, _) in self._cameras]
        native.observe(mask, buffers["state"], images)

    def _final(self, native: _native.Simulator, mask: NDArray[np.bool_]) -> dict[str, Any]:
        buffers = self._new_buffers()
        self._write(native, mask, buffers)
        infos: dict[str, Any] = {}
        for env in map(int, np.flatnonzero(mask)):
            observation = {name: array[env] for name, array in buffers.items()}
            final = {"final_obs": observation, "final_info": _info(native, env)}
            infos = self._add_info(infos, final, env)
        return infos

    def _infos(self, native: _native.Simulator, mask: NDArray[np.bool_]) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        for env in map(int, np.flatnonzero(mask)):
            infos = self._add_info(infos, _info(native, env), env)
        return infos


def make_vec(tasks: str | Sequence[str], num_envs: int | None = None, **options: Any) -> HypogeumVectorEnv:
    """Make a vector env.

    Args:
        tasks: Name of a task, or names of tasks of the same robot.
        num_envs: Number of envs; by default one per combination of task and perturbation.
        **options:
            perturbation: Name, names joined by `+` for several at once, or a list of such. `All` is the benchmark's
                combination of all.
            images: `True` for all cameras, names of some, or `False`. Cameras that are not named are not rendered.
            seed: Suite seed, as `--seed` of a run.
            protocol, control_mode, image_size, instructions, end, profile, strength, language, renderer, samples,
                gpu, threads: As the flags of `hypogeum run`.
            autoreset_mode: One of Gymnasium's.
            render_mode: `rgb_array` makes `render` return frames.
            copy: Return copies of observations instead of the simulator's buffers.

    Raises:
        ValueError: a name or an option is wrong.
        MemoryError: there is not enough memory for that many envs.
        RuntimeError: the renderer cannot be opened.
    """
    return HypogeumVectorEnv(tasks, num_envs, **options)


def _info(native: _native.Simulator, env: int) -> dict[str, Any]:
    info: dict[str, Any] = native.info(env)
    # Gymnasium makes arrays of a type from the values, so that none may be missing.
    missing = {"first_success_step": -1, "failed_predicate": "", "error": ""}
    return {key: missing[key] if value is None else value for key, value in info.items()}


def _select_cameras(
    known: list[tuple[str, int, int]], images: bool | Sequence[str]
) -> list[tuple[int, tuple[str, int, int]]]:
    names = [name for name, _, _ in known]
    wanted = names if images is True else [] if images is False else [images] if isinstance(images, str) else images
    for name in wanted:
        if name not in names:
            raise ValueError(f"images: unknown camera {name!r}; known are {', '.join(names)}")
    return [(index, camera) for index, camera in enumerate(known) if camera[0] in wanted]


def _actions(values: ArrayLike, shape: tuple[int | None, ...]) -> NDArray[np.float32]:
    array = np.asarray(values)
    if not np.issubdtype(array.dtype, np.floating):
        raise TypeError(f"actions are of type {array.dtype}, expected float32")
    fits = array.ndim == len(shape) and all(n in (None, found) for n, found in zip(shape, array.shape, strict=True))
    if not fits:
        expected = ", ".join("rows" if n is None else str(n) for n in shape)
        raise ValueError(f"actions are of shape {list(array.shape)}, expected [{expected}]")
    return np.ascontiguousarray(array, np.float32)


def _mask(values: ArrayLike, n: int) -> NDArray[np.bool_]:
    mask = np.asarray(values)
    if mask.dtype != np.bool_ or mask.shape != (n,):
        raise ValueError(f"reset_mask: expected {n} bool, found {mask.dtype} of shape {list(mask.shape)}")
    return mask


def _index(name: str, value: Any, limit: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 0 <= value <= limit:
        raise ValueError(f"{name}: expected an integer from 0 to {limit}, found {value!r}")
    return int(value)


def _plain(value: Any) -> Any:
    """Return what JSON can express of an array."""
    if not isinstance(value, (np.ndarray, np.generic)):
        raise TypeError(f"a state consists of numbers and texts, found {type(value).__name__}")
    return value.tolist()
