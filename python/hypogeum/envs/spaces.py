"""Gymnasium spaces of observations and actions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from gymnasium import spaces

from .. import _native

# Limits of a TCP's position in m and of its Euler angles in rad, in the arm's root frame.
_POSE = np.array([[-1.0, 1.0]] * 3 + [[-np.pi, np.pi]] * 3)
_GRIPPER = np.array([[-1.0, 1.0]])


def observation_space(state_dim: int, cameras: Iterable[tuple[str, int, int]]) -> spaces.Dict:
    """Return the space of one env: `state`, `[state_dim]` f32, and an image, `[height, width, 3]` u8, per camera."""
    parts: dict[str, spaces.Space[Any]] = {"state": spaces.Box(-np.inf, np.inf, (state_dim,), np.float32)}
    for name, height, width in cameras:
        parts[name] = spaces.Box(0, 255, (height, width, 3), np.uint8)
    return spaces.Dict(parts)


def action_space(control_mode: str, action_dim: int) -> spaces.Box:
    """Return the space of an action row, `[action_dim]` f32. Actions beyond it are executed as in a run."""
    arm = {
        "pd_ee_delta_pose": np.array([[-1.0, 1.0]] * 6),
        "pd_joint_pos": np.array(_native.joint_limits()),
        "pd_ee_pose": _POSE,
    }[control_mode]
    arm = np.concatenate([arm, _GRIPPER])
    bounds = np.tile(arm, (action_dim // len(arm), 1)).astype(np.float32)
    return spaces.Box(bounds[:, 0], bounds[:, 1], dtype=np.float32)
