"""Converts recorded start states of the original simulator for `cargo bench -p benches --bench looks`.

Usage: `recorded_starts.py RECORDINGS STARTS`. Every `ENV_ID.SEED.npz` in the folder RECORDINGS becomes `ENV_ID.SEED.json` in the folder
STARTS: the poses of our bodies (position, then quaternion as w, x, y, z), the joint positions of each arm, and the drawn sizes. An npz
holds `actor/NAME` ([T + 1, 13], the pose first) and `art/NAME/qpos` ([T + 1, n], two arms interleaved); `ENV_ID.SEED.props.json` beside it
holds the actors' collision shapes. Requirements: `python -m pip install numpy`.
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


def start(path):
    """Returns the start state recorded in an npz file."""
    recording = np.load(path)
    env_id = path.stem.rsplit(".", 1)[0]
    result = {"env_id": env_id, "bodies": {}, "arms": [], "sizes": []}
    for key in recording.files:
        parts = key.split("/")
        if parts[0] == "actor" and parts[1].endswith("_env:0"):
            first = recording[key][0].tolist()
            name = parts[1].removesuffix("_env:0")
            body = BODIES.get(name, name)
            result["bodies"][body] = first[:3] + product(first[3:7], frame(env_id, body))
        elif parts[0] == "art" and parts[2] == "qpos":
            first = recording[key][0].tolist()
            n_arms = len(first) // 9
            result["arms"] = [first[arm : 7 * n_arms : n_arms] for arm in range(n_arms)]
    if env_id.startswith("PegInsertionSide"):
        props = json.loads(path.with_suffix(".props.json").read_text())["props"]
        result["sizes"] = peg_and_hole(props)
    return result


def main():
    recordings, starts = map(Path, sys.argv[1:])
    starts.mkdir(parents=True, exist_ok=True)
    for path in sorted(recordings.glob("*-v1.*.npz")):
        (starts / f"{path.stem}.json").write_text(json.dumps(start(path)))


if __name__ == "__main__":
    main()
