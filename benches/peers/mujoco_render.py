"""MuJoCo as the peer of `cargo bench -p benches --bench render -- --peer PYTHON`.

Usage: `mujoco_render.py SCENE_DIR`, where the benchmark has written `scene.xml` and `poses.json`. A request is a line
`SHADOWS SAMPLES` on standard input (0 or 1; 0 or 4) and renders all images of all envs. The response is a line with the elapsed
time in s, which includes setting the poses and reading back the pixels. Requirements: `python -m pip install mujoco==4.0.0`. Uses EGL
unless MUJOCO_GL is set.
"""

import json
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco  # noqa: E402
import numpy as np  # noqa: E402


class Peer:
    def __init__(self, folder: Path):
        self.model = mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))
        self.data = mujoco.MjData(self.model)
        described = json.loads((folder / "poses.json").read_text())
        self.envs = np.array(described["poses"])
        # One renderer per image size and sample count, so that the GL context is switched twice per request,
        # not once per image.
        self.cameras = {}
        for camera, side in enumerate(described["sides"]):
            self.cameras.setdefault(side, []).append(camera)
        self.images = {side: np.empty((side, side, 3), np.uint8) for side in self.cameras}
        self.renderers = {}
        for samples in (0, 4):
            self.model.vis.quality.offsamples = samples
            for side in self.cameras:
                self.renderers[side, samples] = mujoco.Renderer(self.model, side, side)

    def render(self, shadows: bool, samples: int) -> float:
        start = time.perf_counter()
        for side, cameras in self.cameras.items():
            renderer, image = self.renderers[side, samples], self.images[side]
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
            for poses in self.envs:
                self.data.mocap_pos[:] = poses[:, :3]
                self.data.mocap_quat[:] = poses[:, 3:]
                mujoco.mj_kinematics(self.model, self.data)
                mujoco.mj_camlight(self.model, self.data)
                for camera in cameras:
                    renderer.update_scene(self.data, camera)
                    renderer.render(out=image)
        return time.perf_counter() - start


def main() -> None:
    peer = Peer(Path(sys.argv[1]))
    print(f"MuJoCo {mujoco.__version__}", flush=True)
    for request in sys.stdin:
        shadows, samples = map(int, request.split())
        print(peer.render(bool(shadows), samples), flush=True)


if __name__ == "__main__":
    main()
