"""Hypogeum as a benchmark of vla-eval's own runner: `benchmark: hypogeum.vla_eval_benchmark:HypogeumBenchmark`.

Each task of the benchmark is a condition, whose episodes are those of `hypogeum run`: episode `i` of vla-eval is
episode `i` of the suite seed. A model server gets the same observations as from `python -m hypogeum.vla_eval`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vla_eval.benchmarks.base import StepBenchmark, StepResult
from vla_eval.specs import IMAGE_RGB, LANGUAGE, DimSpec
from vla_eval.types import Action, EpisodeResult, Observation, Task

from .envs.conditions import TASKS, conditions
from .envs.single import HypogeumEnv


class HypogeumBenchmark(StepBenchmark):
    """Conditions to evaluate the policy of a model server under.

    Args:
        tasks: Names of tasks, of one robot or both; all tasks by default.
        perturbation: Name, names joined by `+` for several at once, or a list of such.
        seed: Suite seed, as `--seed` of a run.
        **options: Other options of `hypogeum.HypogeumEnv`, such as `protocol`, `control_mode` and `renderer`.

    Raises:
        ValueError: A name is unknown.
    """

    # The renderer is an option of its own, so that either value of vla-eval's `render` is accepted.
    render_backends = frozenset({"gpu", "cpu"})
    _ALL_RECORD_FIELDS = frozenset({"reward", "done", "success"})

    def __init__(
        self,
        tasks: str | Sequence[str] | None = None,
        perturbation: str | Sequence[str] = "None",
        seed: int = 0,
        **options: Any,
    ) -> None:
        super().__init__()
        names = [tasks] if isinstance(tasks, str) else list(tasks or TASKS)
        self._conditions = [it for name in names for it in conditions(name, perturbation)]
        self._options = {"seed": seed, **options}
        self._env: HypogeumEnv | None = None
        self._condition: tuple[str, str] | None = None

    @classmethod
    def configure_render(cls, mode: str) -> dict[str, str]:
        """Set nothing: the option `renderer` chooses."""
        return {}

    def get_tasks(self) -> list[Task]:
        """Return the conditions: `name`, which is unique, `suite`, which is the perturbation, and `task`."""
        return [
            {"name": task if perturbation == "None" else f"{task}_{perturbation}", "suite": perturbation, "task": task}
            for task, perturbation in self._conditions
        ]

    def reset(self, task: Task) -> dict[str, NDArray[Any]]:
        """Start the episode `episode_idx` of a condition and return its first observation.

        Raises:
            ValueError: An option is wrong, or the perturbation does not apply to the task.
        """
        condition = task["task"], task["suite"]
        if self._env is None or condition != self._condition:
            self.cleanup()
            self._env = HypogeumEnv(task["task"], perturbation=task["suite"], **self._options)
            self._condition = condition
        observation, _ = self._env.reset(options={"episode": task.get("episode_idx", 0)})
        self._recorder.record_video(_video_frame(observation))
        return observation

    def step(self, action: Action) -> StepResult:
        """Execute the row `actions`, `[action_dim]`.

        Raises:
            ValueError: There is no such key, or the row has another shape or is not finite.
        """
        assert self._env is not None, "reset comes first"
        if "actions" not in action:
            raise ValueError(f"the server answered {', '.join(map(repr, action))}, expected 'actions'")
        row = np.asarray(action["actions"], np.float32)
        shape = self._env.action_space.shape
        if row.shape != shape:
            advice = "; set chunk_size of the server, which then sends single rows" if row.ndim > 1 else ""
            raise ValueError(f"the server answered actions {list(row.shape)}, expected {list(shape or ())}{advice}")
        observation, reward, terminated, truncated, info = self._env.step(row)
        done = terminated or truncated
        self._recorder.record_video(_video_frame(observation))
        self._recorder.record_step(reward=reward, done=done, success=info["is_success"])
        return StepResult(observation, reward, done, info)

    def make_obs(self, raw_obs: dict[str, NDArray[Any]], task: Task) -> Observation:
        """Return `images`, by camera `[height, width, 3]` u8, `state`, the whole state f32, and `task_description`."""
        assert self._env is not None, "reset comes first"
        images = {name: array for name, array in raw_obs.items() if name != "state"}
        return {"images": images, "state": raw_obs["state"], "task_description": self._env.task_description}

    def get_step_result(self, step_result: StepResult) -> EpisodeResult:
        """Return `success` (at any step), `first_success_step` (-1 if none), `fingerprint`, and `error` (empty if none)."""
        info = step_result.info
        names = ("first_success_step", "fingerprint", "error")
        return {"success": info["is_success"], **{name: info[name] for name in names}}

    def get_metadata(self) -> dict[str, Any]:
        """Return the longest horizon; an episode ends at that of its task."""
        return {"max_steps": max(int(TASKS[task]["max_steps"]) for task, _ in self._conditions)}

    def get_action_spec(self) -> dict[str, DimSpec]:
        """Return what an action row consists of."""
        mode = self._options.get("control_mode") or "the robot's default"
        return {"actions": DimSpec("actions", 0, mode, description="docs/benchmark.md")}

    def get_observation_spec(self) -> dict[str, DimSpec]:
        """Return what an observation consists of."""
        return {"image": IMAGE_RGB, "state": DimSpec("state", 0, "hypogeum_state"), "language": LANGUAGE}

    def cleanup(self) -> None:
        """Free the simulator."""
        if self._env is not None:
            self._env.close()
            self._env = None

    def render(self) -> NDArray[np.uint8] | None:
        """Return the image of the first external camera."""
        return None if self._last_result.obs is None else _video_frame(self._last_result.obs)


def _video_frame(observation: dict[str, NDArray[Any]]) -> NDArray[np.uint8]:
    return observation["external1_camera"]
