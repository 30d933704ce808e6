"""Conversion of a recording of the original into a trajectory."""

import json

import numpy as np
import pytest
from convert_recordings import convert


def recording(folder, n_steps=3):
    """Writes a made-up recording of RotateArrow, in which only shapes and frames matter."""
    actor = np.zeros((n_steps + 1, 13), np.float32)
    actor[:, 3] = 1
    actor[0, :3] = [-0.3, -0.2, 0.0119]
    actor[0, 7:10] = [0, 0, -0.1]
    path = folder / "RotateArrow-v1.4.npz"
    np.savez(
        path,
        **{
            "actor/arrow_env:0": actor,
            "actor/table": actor,
            "art/panda_wristcam/qpos": np.tile(np.arange(9, dtype=np.float32), (n_steps + 1, 1)),
            "art/panda_wristcam/qvel": np.zeros((n_steps + 1, 9), np.float32),
        },
        actions=np.zeros((n_steps, 8), np.float32),
        success=np.array([False, True, True]),
        tcp=np.zeros((n_steps + 1, 1, 7), np.float32),
    )
    return path


def test_recording_becomes_a_trajectory(tmp_path):
    trajectory = convert(recording(tmp_path), "made up")
    assert json.loads(json.dumps(trajectory)) == trajectory
    assert (trajectory["task"], trajectory["control_mode"]) == ("RotateArrow-v1", "pd_joint_pos")
    assert trajectory["arms"] == [{"qpos": list(map(float, range(9))), "qvel": [0.0] * 9}]
    assert list(trajectory["bodies"]) == ["arrow"]
    arrow = trajectory["bodies"]["arrow"]
    # Our arrow's frame is turned by −90° about x in its actor's frame.
    assert arrow["pose"] == pytest.approx([-0.3, -0.2, 0.0119, 0.5**0.5, -(0.5**0.5), 0, 0])
    assert arrow["linear_velocity"] == pytest.approx([0, 0, -0.1])
    recorded = trajectory["recorded"]
    assert recorded["first_success_step"] == 2
    assert len(trajectory["actions"]) == len(recorded["qpos"]) == len(recorded["tcp"]) == 3
