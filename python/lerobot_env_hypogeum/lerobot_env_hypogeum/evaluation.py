"""A vector env as LeRobot's evaluator drives it."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from lerobot.envs.utils import NEW_ROLLOUT_OPTION
from lerobot.utils.constants import OBS_STATE, OBS_STR
from numpy.typing import ArrayLike, NDArray

from hypogeum.envs.conditions import Condition
from hypogeum.envs.vector import HypogeumVectorEnv, Observation
from hypogeum.images import resize
from hypogeum.language import hashed_embedding
from hypogeum.mapping import IMAGES, Mapping

# Camera of the evaluator's videos.
EXTERNAL_CAMERA = "external1_camera"

log = logging.getLogger("hypogeum")
embedding = lru_cache(maxsize=1024)(hashed_embedding)


class EvaluationEnv(HypogeumVectorEnv):
    """Envs of one condition, whose observations have the features of a policy.

    LeRobot's evaluator resets all envs for each batch of episodes, and steps them until the last episode has ended.
    An env whose episode has ended stays as it is until the next reset, and costs nothing.

    Args:
        condition: Task and perturbation.
        num_envs: Number of envs.
        mapping: Sources of the policy's features.
        options: Options of `hypogeum.make_vec`.
    """

    def __init__(self, condition: Condition, num_envs: int, mapping: Mapping, options: dict[str, Any]):
        self._mapping = mapping
        self._held = np.zeros(num_envs, bool)
        self._first_seed: int | None = None
        super().__init__(
            condition.task, num_envs, perturbation=condition.perturbation, autoreset_mode=AutoresetMode.DISABLED,
            images=list(dict.fromkeys(camera for camera, *_ in mapping.images.values())), render_mode="rgb_array",
            **options,
        )  # fmt: skip
        self.single_observation_space = _space(mapping)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode in each env.

        Args:
            seed: Seeds of the evaluator. The env with the first seed that this object ever gets runs episode 0, and
                the env with a seed that is greater by k runs episode k. None starts the next episodes.
            options: As for `HypogeumVectorEnv.reset`.
        """
        options = {name: value for name, value in (options or {}).items() if name != NEW_ROLLOUT_OPTION}
        if seed is not None:
            seeds = list(range(seed, seed + self.num_envs)) if isinstance(seed, (int, np.integer)) else list(seed)
            if self._first_seed is None:
                self._first_seed = seeds[0]
            options["episode"] = [it - self._first_seed for it in seeds]
        return super().reset(options=options)

    def step(
        self, actions: ArrayLike
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Execute an action row, `[action_dim]` f32, in each env whose episode has not ended.

        The evaluator reads `is_success` of `final_info`, where an episode has ended, or of `infos`.
        """
        self._held = self._is_over
        # Otherwise the base class refuses to step. The simulator ignores the actions after an episode's end.
        self._is_over = np.zeros(self.num_envs, bool)
        observation, rewards, terminated, truncated, infos = super().step(actions)
        ended = self._is_over & ~self._held
        for env in np.flatnonzero(ended):
            if infos["error"][env]:
                task, episode = infos["task"][env], infos["episode"][env]
                log.warning("episode %d of %s ended with an error: %s", episode, task, infos["error"][env])
        if ended.any():
            infos["final_info"] = {"is_success": infos["is_success"]}
        return observation, rewards, terminated, truncated, infos

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of each env, or get an attribute; `render` returns images of the last observation."""
        if name == "render" and EXTERNAL_CAMERA in self._buffers[0]:
            return tuple(self._buffers[0][EXTERNAL_CAMERA])
        return super().call(name, *args, **kwargs)

    def _observe(self, native: Any) -> Observation:
        held = self._held & self._is_over
        self._buffers.reverse()
        newer, older = self._buffers
        for name, array in newer.items():
            array[held] = older[name][held]
        self._write(native, ~held, newer)
        return self._features(newer)

    def _features(self, observation: Observation) -> Observation:
        pixels: Observation = {}
        for name, (camera, *size) in self._mapping.images.items():
            pixels[name.removeprefix(IMAGES)] = _resized(observation[camera], *size)
        found: dict[str, Any] = {"pixels": pixels}
        for name, parts in self._mapping.states.items():
            found[key_of(name)] = np.concatenate([observation["state"][:, part] for part in parts], axis=1)
        for name, dim in self._mapping.languages.items():
            found[key_of(name)] = np.stack([embedding(text, dim) for text in self._instructions])
        return found


def key_of(feature: str) -> str:
    """Return the key of a feature without images in an observation; LeRobot adds `observation.` to most."""
    return "agent_pos" if feature == OBS_STATE else feature.removeprefix(f"{OBS_STR}.")


def _resized(images: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8]:
    if images.shape[1:3] == (height, width):
        return images
    pixels = resize(torch.from_numpy(images), height, width)
    resized: NDArray[np.uint8] = pixels.to(torch.uint8).permute(0, 2, 3, 1).contiguous().numpy()
    return resized


def _space(mapping: Mapping) -> spaces.Dict:
    pixels: dict[str, spaces.Space[Any]] = {
        name.removeprefix(IMAGES): spaces.Box(0, 255, (height, width, 3), np.uint8)
        for name, (_, height, width) in mapping.images.items()
    }
    widths = {name: sum(part.stop - part.start for part in parts) for name, parts in mapping.states.items()}
    widths |= mapping.languages
    vectors = {key_of(name): spaces.Box(-np.inf, np.inf, (width,), np.float32) for name, width in widths.items()}
    return spaces.Dict({"pixels": spaces.Dict(pixels), **vectors})
