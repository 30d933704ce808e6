"""Serves a policy for RaiseCube in plain numpy: finds the blue cube in a camera image, then grasps and lifts it."""

import hypogeum
import numpy as np

# Pose and field of view of `external1` in RaiseCube (docs/benchmark.md, "Cameras").
EYE = np.array([0.2, -0.3, 0.3])
TARGET = np.array([-0.1, 0.0, 0.1])
SIDE, FOV_Y = 224, np.deg2rad(90)

CUBE_CENTRE_Z = 0.02
HOVER_Z, LIFT_Z = 0.12, 0.30
# Fraction of the remaining distance to command per control step, and its limit in units of 0.1 m.
GAIN, MAX_STEP = 0.35, 0.3


def locate_cube(image):
    """Returns the cube's position [3] in the world, from an image [224, 224, 3] u8.

    Falls back to the middle of the table if nothing in the image is blue, for example under MO-Color.
    """
    red, green, blue = np.moveaxis(image.astype(int), -1, 0)
    rows, columns = np.nonzero((blue > red + 40) & (blue > green + 30))
    if len(rows) == 0:
        return np.array([0.0, 0.0, CUBE_CENTRE_Z])
    # Ray through the centroid, in the camera frame: x forward, y left, z up.
    focal = SIDE / 2 / np.tan(FOV_Y / 2)
    left = (SIDE / 2 - columns.mean() - 0.5) / focal
    up = (SIDE / 2 - rows.mean() - 0.5) / focal
    forward = (TARGET - EYE) / np.linalg.norm(TARGET - EYE)
    y_axis = np.cross([0, 0, 1], forward)
    y_axis /= np.linalg.norm(y_axis)
    ray = forward + left * y_axis + up * np.cross(forward, y_axis)
    return EYE + ray * (CUBE_CENTRE_Z - EYE[2]) / ray[2]


class Grasp:
    """State of one episode: where the cube is, and which waypoint comes next."""

    def __init__(self, image):
        x, y, z = locate_cube(image)
        self.waypoints = [(x, y, HOVER_Z), (x, y, z), (x, y, z), (x, y, LIFT_Z)]
        self.gripper = [1, 1, -1, -1]
        self.stage = 0
        self.closed_for = 0

    def act(self, tcp, n_rows):
        """Returns [n_rows, 7] actions, given the TCP position [3]."""
        error = np.subtract(self.waypoints[self.stage], tcp)
        if self.stage == 2:
            self.closed_for += n_rows
            done = self.closed_for >= 8
        else:
            done = np.linalg.norm(error) < 0.01
        if done and self.stage < 3:
            self.stage += 1
            error = np.subtract(self.waypoints[self.stage], tcp)
        row = np.zeros(7)
        row[:3] = np.clip(error / 0.1 * GAIN, -MAX_STEP, MAX_STEP)
        row[6] = self.gripper[self.stage]
        return np.tile(row, (n_rows, 1))


episodes = {}


def policy(observation):
    chunks = []
    for env in observation:
        if env.query == 0:
            episodes[env.slot] = Grasp(env.cameras["external1_camera"])
        tcp = env.state[18:21]
        chunks.append(episodes[env.slot].act(tcp, env.execute))
    return chunks


if __name__ == "__main__":
    print(hypogeum.serve(policy, "numpy"))
