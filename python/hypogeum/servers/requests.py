"""Mapping from an observation to the request of a policy server.

The file has the syntax of `hypogeum.json`. Its `mapping` is the request: keys of any depth, with a camera, a list of
parts of the state, or a word as the source of each value:

    {"morphology": "single", "control_mode": "pd_ee_delta_pose",
     "mapping": {"observation/image": "external1_camera", "observation/state": ["qpos[0:8]"], "prompt": "instruction"}}
"""

import numpy as np

from ..layout import CONTROL_MODES, MORPHOLOGIES
from ..mapping import MappingError, parse_settings
from ..robot import CAMERAS, STATE_PARTS, state_slice

KEYS = {"morphology", "control_mode", "mapping"}
# Sources that are neither images nor states.
WORDS = ("instruction", "policy_seed", "query")


def read_mapping(path):
    """Return the settings in the file `path`, or raise `MappingError`."""
    if not path.is_file():
        raise MappingError(f"there is no mapping {path}")
    settings = parse_settings(path, KEYS)
    for key, known in (("morphology", MORPHOLOGIES), ("control_mode", CONTROL_MODES)):
        if settings.get(key) not in (None, *known):
            raise MappingError(f"{path}: `{key}` is {settings[key]!r}, expected {' or '.join(known)}")
    return settings


class Requests:
    """Requests for envs of one morphology.

    Args:
        sources: Source of each value, a dict of any depth.
        morphology: Name of the morphology.

    Raises:
        MappingError: A value has no source, or no camera is among them. Lists every problem.
    """

    def __init__(self, sources, morphology):
        self.cameras = []
        problems = []
        self.sources = self._resolve(sources, morphology, "", problems)
        if not problems and not self.cameras:
            problems.append("no value is a camera; a policy that sees nothing needs no server")
        if problems:
            parts = ", ".join(f"{part} {width}" for part, width in STATE_PARTS[morphology])
            raise MappingError(
                f"the request to the server cannot be made: {'; '.join(problems)}; a {morphology} robot has the "
                f"cameras {', '.join(CAMERAS[morphology])}, the state parts {parts}, and {', '.join(WORDS)}"
            )

    def request(self, env):
        """Return the request for an `EnvObservation`, whose images are those of the observation."""
        return fill(self.sources, env)

    def _resolve(self, source, morphology, key, problems):
        """Return the source of a value with names replaced by slices of the state, and note problems."""
        if isinstance(source, dict):
            return {name: self._resolve(of, morphology, f"{key}.{name}", problems) for name, of in source.items()}
        try:
            if isinstance(source, str):
                camera = next((name for name in (source, f"{source}_camera") if name in CAMERAS[morphology]), None)
                if camera is not None:
                    self.cameras.append(camera)
                if camera is not None or source in WORDS:
                    return camera or source
            parts = [source] if isinstance(source, str) else source
            if not isinstance(parts, list) or not parts or not all(isinstance(part, str) for part in parts):
                raise ValueError("expected a camera, a list of parts of the state, or another source")
            return [state_slice(morphology, part) for part in parts]
        except ValueError as problem:
            problems.append(f"{key[1:] or 'mapping'}: {source!r}: {problem}")


def fill(source, env):
    """Return the value that a resolved source has in an env."""
    if isinstance(source, dict):
        return {name: fill(of, env) for name, of in source.items()}
    if isinstance(source, list):
        return np.concatenate([env.state[part] for part in source])
    return getattr(env, source) if source in WORDS else env.cameras[source]
