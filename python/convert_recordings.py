"""Converts recordings of the original simulator into trajectories (docs/trajectories.md).

Usage: `convert_recordings.py RECORDINGS TRAJECTORIES [SOURCE]`. Every `ENV_ID.SEED.npz` in the folder RECORDINGS becomes `ENV_ID.SEED.json`
in the folder TRAJECTORIES, which `hypogeum replay --start` and the benchmarks `agreement` and `looks` read. SOURCE says in words which
simulator recorded them. An npz of T steps holds `actions` ([T, action_dim]), `success` ([T]), `tcp` ([T + 1, n_arms, 7]), `actor/NAME`
([T + 1, 13]: pose, linear and angular velocity) and `art/NAME/qpos` and `/qvel` ([T + 1, n_dofs], the joints of two arms interleaved);
`ENV_ID.SEED.props.json` beside it holds the actors' collision shapes. A file of any other name holds motions of the arm alone,
`MODE/KIND/SEED/` followed by `a` (actions), `Q` and `V` (joints) and `T` (TCP); they become trajectories of RaiseCube with the cube out of
reach, named after file, mode and kind. Requirements: `python -m pip install numpy`.
"""

import json
import sys
from pathlib import Path

import numpy as np

# Names of our bodies that differ from the actors'.
BODIES = {
    "ball": "tomato",
    "box_with_hole": "box",
    "cubeA": "red cube",
    "cubeB": "green cube",
    "cubeC": "blue cube",
    "dish_rack": "rack",
    "goal_region": "goal",
    "ring_tripod": "tripod",
}
# Orientations of our bodies' frames in the actors' frames, as w, x, y, z.
HALF = 0.5**0.5
FRAMES = {
    "arrow": (HALF, -HALF, 0.0, 0.0),
    "pot": (0.5, -0.5, -0.5, -0.5),
    "tray": (0.5, -0.5, -0.5, -0.5),
    "tomato": (HALF, HALF, 0.0, 0.0),
}
# The goal disc of the stacking tasks lies on its side in its own frame.
STACK_GOAL = (HALF, 0.0, -HALF, 0.0)


def product(a, b):
    """Returns the product of two quaternions."""
    (aw, *av), (bw, *bv) = a, b
    vector = aw * np.array(bv) + bw * np.array(av) + np.cross(av, bv)
    return [aw * bw - float(np.dot(av, bv)), *vector.tolist()]


def frame(env_id, body):
    """Returns the orientation of our body's frame in its actor's frame."""
    if body == "goal" and "Stack" in env_id:
        return STACK_GOAL
    return FRAMES.get(body, (1.0, 0.0, 0.0, 0.0))


def peg_and_hole(props):
    """Returns the sizes drawn for PegInsertionSide: half length, half width, and the hole's y and z in [−1, 1]."""
    length, width, _ = props["peg_env:0"]["shapes"][0]["half_size"]
    walls = props["box_with_hole_env:0"]["shapes"]

    def centre(axis, upper, lower):
        faces = [wall["p"][axis] + side * wall["half_size"][axis] for wall, side in ((upper, -1), (lower, 1))]
        return sum(faces) / (length - width)

    return [length, width, centre(1, *walls[:2]), centre(2, *walls[2:])]


def arms(first):
    """Splits one row of joint values, in which the joints of two arms are interleaved, into rows of nine per arm."""
    n_arms = len(first) // 9
    fingers = first[7 * n_arms :]
    return [[*first[arm : 7 * n_arms : n_arms], *fingers[2 * arm : 2 * arm + 2]] for arm in range(n_arms)]


def rounded(values, digits):
    """Rounds all numbers of nested sequences to save space."""
    if isinstance(values, (list, tuple)):
        return [rounded(value, digits) for value in values]
    return round(float(values), digits)


def body_pose(row, env_id, body):
    """Returns the pose of our body's frame, given a row of its actor."""
    return [*row[:3], *product(row[3:7], frame(env_id, body))]


def convert(path, source):
    """Returns the trajectory recorded in an npz file."""
    recording = np.load(path)
    env_id = path.stem.rsplit(".", 1)[0]
    joints = {
        key.split("/")[2]: [arms(row) for row in recording[key].tolist()]
        for key in recording.files
        if key.startswith("art/") and key.endswith(("/qpos", "/qvel"))
    }
    bodies, ends = {}, {}
    for key in recording.files:
        name = key.removeprefix("actor/").removesuffix("_env:0")
        if not key.startswith("actor/") or not key.endswith("_env:0"):
            continue
        body, rows = BODIES.get(name, name), recording[key].tolist()
        bodies[body] = {
            "pose": rounded(body_pose(rows[0], env_id, body), 8),
            "linear_velocity": rounded(rows[0][7:10], 8),
            "angular_velocity": rounded(rows[0][10:13], 8),
        }
        ends[body] = rounded(body_pose(rows[-1], env_id, body), 5)
    succeeded = recording["success"].nonzero()[0]
    trajectory = {
        "task": env_id,
        "control_mode": "pd_joint_pos",
        "arms": [
            {"qpos": rounded(qpos, 8), "qvel": rounded(qvel, 8)}
            for qpos, qvel in zip(joints["qpos"][0], joints["qvel"][0])
        ],
        "bodies": bodies,
        "actions": rounded(recording["actions"].tolist(), 7),
        "recorded": {
            "source": source,
            "first_success_step": int(succeeded[0]) + 1 if len(succeeded) else None,
            "success_at_end": bool(recording["success"][-1]),
            "qpos": rounded(joints["qpos"][1:], 5),
            "tcp": rounded(recording["tcp"][1:, :, :3].tolist(), 5),
            "bodies_at_end": ends,
        },
    }
    if env_id.startswith("PegInsertionSide"):
        props = json.loads(path.with_suffix(".props.json").read_text())["props"]
        trajectory["sizes"] = rounded(peg_and_hole(props), 8)
    return trajectory


def convert_arm(path, source):
    """Yields name and trajectory of each motion of the arm alone in an npz file."""
    recording = np.load(path)
    for key in recording.files:
        if not key.endswith("/a"):
            continue
        mode, kind, seed, _ = key.split("/")
        part = {name: recording[f"{mode}/{kind}/{seed}/{name}"].tolist() for name in "aQVT"}
        # The batched inverse kinematics of `pd_ee_delta_pose` is the rule that evaluations use.
        mode = mode.replace("LM_ee", "pd_ee")
        yield (
            f"{path.stem}-{mode}-{kind}.{seed}",
            {
                "task": "RaiseCube",
                "control_mode": mode,
                "arms": [{"qpos": rounded(part["Q"][0], 8), "qvel": rounded(part["V"][0], 8)}],
                "bodies": {"cube": {"pose": [0.3, 1.0, 0.02, 1, 0, 0, 0]}},
                "actions": rounded(part["a"], 7),
                "recorded": {
                    "source": f"{source}, {path.name}",
                    "first_success_step": None,
                    "success_at_end": False,
                    "qpos": [[row] for row in rounded(part["Q"][1:], 6)],
                    "tcp": [[row[:3]] for row in rounded(part["T"][1:], 6)],
                    "bodies_at_end": {},
                },
            },
        )


def main():
    """Converts all recordings of a folder."""
    recordings, trajectories = map(Path, sys.argv[1:3])
    source = sys.argv[3] if len(sys.argv) > 3 else "unknown simulator"
    trajectories.mkdir(parents=True, exist_ok=True)
    for path in sorted(recordings.glob("*.npz")):
        is_task = "-v1." in path.name
        converted = [(path.stem, convert(path, f"{source}, {path.name}"))] if is_task else convert_arm(path, source)
        for name, trajectory in converted:
            (trajectories / f"{name}.json").write_text(json.dumps(trajectory, separators=(",", ":")))


if __name__ == "__main__":
    main()
