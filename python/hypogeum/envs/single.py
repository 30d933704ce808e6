"""A single env: Gymnasium's `Env` over a vector env of one."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from .vector import HypogeumVectorEnv, Observation, _info


class HypogeumEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """One env. Its options are those of `hypogeum.make_vec`; observations are copies, and it uses one thread."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}

    def __init__(self, task: str, *, threads: int = 1, **options: Any):
        """See `hypogeum.make_vec`."""
        self._vector = HypogeumVectorEnv(
            task, 1, threads=threads, autoreset_mode=AutoresetMode.DISABLED, copy=True, **options
        )
        self.render_mode = self._vector.render_mode
        self.observation_space = self._vector.single_observation_space
        self.action_space = self._vector.single_action_space

    @property
    def task(self) -> str:
        """Name of the task."""
        return self._vector.envs[0].task

    @property
    def task_description(self) -> str:
        """Instruction of the current episode."""
        return self._vector.envs[0].task_description

    @property
    def _max_episode_steps(self) -> int:
        return self._vector.envs[0]._max_episode_steps

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start the next episode; see `HypogeumVectorEnv.reset`."""
        super().reset(seed=seed)
        observation, _ = self._vector.reset(seed=seed, options=options)
        return _first(observation), self._info()

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Execute an action row, `[action_dim]` f32; see `HypogeumVectorEnv.step`."""
        row = np.asarray(action)
        observation, rewards, terminated, truncated, _ = self._vector.step(row[None])
        return _first(observation), float(rewards[0]), bool(terminated[0]), bool(truncated[0]), self._info()

    def render(self) -> NDArray[np.uint8] | None:
        """Return the image of the first external camera, if `render_mode` is `rgb_array`."""
        frames = self._vector.render()
        return None if frames is None else frames[0]

    def get_state(self) -> dict[str, Any]:
        """Return the state; see `HypogeumVectorEnv.get_state`."""
        return self._vector.get_state()[0]

    def set_state(self, state: dict[str, Any]) -> Observation:
        """Set the state; see `HypogeumVectorEnv.set_state`."""
        return _first(self._vector.set_state([state]))

    def close(self) -> None:
        """Free the simulator."""
        self._vector.close()

    def _info(self) -> dict[str, Any]:
        return _info(self._vector._open(), 0)


def _first(observation: Observation) -> Observation:
    return {name: array[0] for name, array in observation.items()}
