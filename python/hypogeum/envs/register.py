"""Registration with Gymnasium, when `hypogeum.envs` is imported."""

from typing import Any

import gymnasium

from .conditions import TASKS
from .vector import HypogeumVectorEnv


def register() -> None:
    """Register `hypogeum/TASK` for every task."""
    for task in TASKS:
        name = f"hypogeum/{task}"
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="hypogeum.envs.single:HypogeumEnv",
                vector_entry_point="hypogeum.envs.register:make_registered",
                kwargs={"task": task},
            )


def make_registered(task: str, **options: Any) -> HypogeumVectorEnv:
    """Make a vector env of a registered task."""
    return HypogeumVectorEnv(task, **options)
