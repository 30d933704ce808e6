"""Mapping from the benchmark's cameras and state parts to the input features of a checkpoint.

Feature names and shapes determine the mapping as far as possible, with the names in the environment that the
checkpoint's `rename_map` gives. `hypogeum.json` next to the checkpoint's `config.json` overrides or completes it. All
its keys are optional:

    {"morphology": "single", "control_mode": "pd_ee_delta_pose", "protocol": "act",
     "mapping": {"observation.images.front": "external1_camera", "observation.state": ["qpos", "tcp_pose"],
                 "observation.environment_state": "language"},
     "language": {"encoder": "hashed", "dim": 512}}

A part of the state may be followed by a slice, as in `"qpos[0:8]"`. `ignore` lists keys of `config.json` to leave out.
For π0.5 it may also contain `prompt_state`, "unpadded" or "padded", and `vision_heads`; for policies that mask missing
cameras, a camera may be mapped to "none". `chunk_size` belongs to openpi's layout, which only the built-in π0.5 reads.
"""

import json
from dataclasses import dataclass
from pathlib import Path

from .layout import CONTROL_MODES, MORPHOLOGIES
from .robot import CAMERAS, STATE_PARTS, state_slice

FILE = "hypogeum.json"
IMAGES, STATE = "observation.images.", "observation.state"
# Name of the instruction's embedding in a mapping.
LANGUAGE = "language"
# Source of a camera that the robot does not have.
NO_CAMERA = "none"
KEYS = {"morphology", "control_mode", "protocol", "mapping", "language", "prompt_state", "vision_heads", "chunk_size", "ignore"}
PROMPT_STATES = ("unpadded", "padded")
PROTOCOLS = ("act", "lerobot")
ENCODERS = ("hashed",)
# Substring of the names of features that LeRobot fills in itself if they are missing.
EMPTY_CAMERA = ".empty_camera_"
# Default morphology and control mode by action width.
BY_ACTION_DIM = {
    7: ("single", "pd_ee_delta_pose"),
    8: ("single", "pd_joint_pos"),
    14: ("bimanual", "pd_ee_delta_pose"),
    16: ("bimanual", "pd_joint_pos"),
}


class MappingError(ValueError):
    """A checkpoint whose inputs cannot be provided, or whose actions cannot be executed."""


@dataclass(frozen=True)
class Feature:
    """An input feature of a checkpoint."""

    kind: str
    """LeRobot's feature type: "VISUAL", "STATE" or "ENV"."""
    shape: tuple


@dataclass(frozen=True)
class Mapping:
    """Sources of a checkpoint's input features."""

    morphology: str
    control_mode: str
    images: dict
    """(camera, height, width) by feature."""
    states: dict
    """Slices of the state vector by feature."""
    languages: dict
    """Width of the instruction's embedding by feature."""

    def inputs(self):
        """Return the names of the features that have a source."""
        return {*self.images, *self.states, *self.languages}


def read_settings(folder):
    """Read `hypogeum.json` from a checkpoint's folder; return an empty dict if there is none."""
    path = Path(folder) / FILE
    if not path.is_file():
        return {}
    settings = parse_settings(path, KEYS)
    prompt_state = settings.get("prompt_state", PROMPT_STATES[0])
    if prompt_state not in PROMPT_STATES:
        raise MappingError(f"{path}: `prompt_state` is {prompt_state!r}, expected {' or '.join(PROMPT_STATES)}")
    protocol = settings.get("protocol", PROTOCOLS[0])
    if protocol not in PROTOCOLS:
        raise MappingError(f"{path}: `protocol` is {protocol!r}, expected {' or '.join(PROTOCOLS)}")
    n_heads = settings.get("vision_heads", 1)
    if type(n_heads) is not int or n_heads < 1:
        raise MappingError(f"{path}: `vision_heads` is {n_heads!r}, expected a positive integer")
    ignored = settings.get("ignore", [])
    if not isinstance(ignored, list) or not all(isinstance(key, str) for key in ignored):
        raise MappingError(f"{path}: `ignore` is {ignored!r}, expected a list of keys")
    return settings


def parse_settings(path, keys):
    """Return the settings in the file `path`, an object with some of `keys`, of which `mapping` is one."""
    try:
        settings = json.loads(path.read_text())
    except ValueError as error:
        raise MappingError(f"{path} is not valid JSON: {error}") from error
    if not isinstance(settings, dict):
        raise MappingError(f"{path} contains {type(settings).__name__}, expected an object")
    unknown = set(settings) - keys
    if unknown:
        raise MappingError(f"{path} has unknown keys {sorted(unknown)}")
    if not isinstance(settings.get("mapping", {}), dict):
        raise MappingError(f"{path}: `mapping` is {settings['mapping']!r}, expected an object")
    return settings


def make_mapping(features, action_dim, settings, masks_cameras=False, rename_map=None, hashed=()):
    """Determine the `Mapping` of a checkpoint.

    Args:
        features: Input `Feature`s by name.
        action_dim: Width of the checkpoint's action rows.
        settings: Contents of `hypogeum.json`.
        masks_cameras: Whether the policy masks cameras that are missing in its input.
        rename_map: Names of features by their names in the environment, as saved in the checkpoint.
        hashed: Names of features that the checkpoint records as hashed embeddings of the instruction.

    Raises:
        MappingError: A feature has no source, or the actions match no control mode. Lists every problem.
    """
    morphology, control_mode = robot(action_dim, settings)
    problems = []
    images, states, languages = {}, {}, {}
    sources = settings.get("mapping", {})
    for name in sources.keys() - features.keys():
        problems.append(f"{name}: {FILE} maps it, but the checkpoint has no such feature")
    if "language" in settings and all(feature.kind != "ENV" for feature in features.values()):
        problems.append(f"`language` in {FILE}: this policy reads no embedding of the instruction")
    for name, feature in features.items():
        source = sources.get(name)
        if source is None and EMPTY_CAMERA in name:
            continue
        originals = [] if source is not None else [old for old, new in (rename_map or {}).items() if new == name]
        original = originals[0] if originals else name
        try:
            if len(originals) > 1:
                raise ValueError("expected a single source")
            if feature.kind == "VISUAL" and source == NO_CAMERA:
                if not masks_cameras:
                    raise ValueError(f'it cannot be mapped to "{NO_CAMERA}": this policy needs all its cameras')
            elif feature.kind == "VISUAL":
                images[name] = image_source(original, feature, source, morphology)
            elif feature.kind == "STATE":
                states[name] = state_source(original, feature, source, morphology)
            elif feature.kind == "ENV" and source in (None, LANGUAGE):
                languages[name] = language_width(feature, settings, name in hashed)
            else:
                raise ValueError(f'it can only be mapped to "{LANGUAGE}"')
        except ValueError as problem:
            renamed = f"rename_map takes it from {' and from '.join(originals)}: " if originals else ""
            problems.append(f"{name}: {renamed}{problem}")
    if masks_cameras and not images:
        problems.append("all cameras are missing, at least one is needed")
    if problems:
        raise MappingError(describe(problems, features, morphology))
    return Mapping(morphology, control_mode, images, states, languages)


def robot(action_dim, settings):
    """Return the morphology and control mode of actions of width `action_dim`."""
    known = BY_ACTION_DIM.get(action_dim, (None, None))
    morphology = settings.get("morphology", known[0])
    if morphology not in MORPHOLOGIES:
        raise MappingError(
            f"the checkpoint's actions have width {action_dim} and `morphology` is {morphology!r}, "
            f"expected {' or '.join(MORPHOLOGIES)}; set it in {FILE}"
        )
    widths = MORPHOLOGIES[morphology].action_dim
    control_mode = settings.get("control_mode", known[1])
    if widths.get(control_mode) != action_dim:
        modes = ", ".join(f"{mode} {widths[mode]}" for mode in CONTROL_MODES)
        raise MappingError(
            f"the checkpoint's actions have width {action_dim}, which does not match control mode {control_mode!r} of "
            f"a {morphology} robot ({modes}); set `morphology` and `control_mode` in {FILE}"
        )
    return morphology, control_mode


def image_source(name, feature, source, morphology):
    """Return the camera, height and width for a VISUAL feature."""
    cameras = CAMERAS[morphology]
    short = name.removeprefix(IMAGES) if source is None else source
    candidates = [short, f"{short}_camera"]
    camera = next((camera for camera in candidates if camera in cameras), None)
    if camera is None:
        raise ValueError(f"there is no camera {' or '.join(map(repr, candidates))}")
    if len(feature.shape) != 3 or feature.shape[0] != 3:
        raise ValueError(f"its shape is {list(feature.shape)}, expected [3, height, width]")
    return camera, feature.shape[1], feature.shape[2]


def state_source(name, feature, source, morphology):
    """Return the slices of the state vector for a STATE feature."""
    if len(feature.shape) != 1:
        raise ValueError(f"its shape is {list(feature.shape)}, expected [width]")
    width, state_dim = feature.shape[0], MORPHOLOGIES[morphology].state_dim
    if source is None and name == STATE:
        source = default_parts(morphology, width)
    if isinstance(source, str):
        source = [source]
    if not isinstance(source, list):
        raise ValueError(f"map it to a list of state parts of total width {width} (the whole state has {state_dim})")
    slices = [state_slice(morphology, part) for part in source]
    found = sum(part.stop - part.start for part in slices)
    if found != width:
        raise ValueError(f"{' + '.join(source)} has width {found}, the feature has {width}")
    return slices


def default_parts(morphology, width):
    """Return the parts of the state in a feature of width `width` whose source nobody names, or None."""
    parts = dict(STATE_PARTS[morphology])
    defaults = [list(parts), ["qpos"], ["qpos", "qvel"]]
    return next((names for names in defaults if sum(parts[part] for part in names) == width), None)


def language_width(feature, settings, is_hashed):
    """Return the embedding width for an ENV feature; `is_hashed` if the checkpoint records the encoder."""
    language = settings.get("language")
    if language is None and is_hashed:
        return feature.shape[0]
    if not isinstance(language, dict) or language.get("encoder") not in ENCODERS:
        needed = {"language": {"encoder": ENCODERS[0], "dim": feature.shape[0]}}
        raise ValueError(f'"language" needs {json.dumps(needed)} in {FILE}')
    if (language.get("dim"),) != tuple(feature.shape):
        raise ValueError(f"`language.dim` is {language.get('dim')}, the feature has width {feature.shape[0]}")
    return feature.shape[0]


def describe(problems, features, morphology):
    """Return an error message with all problems, the checkpoint's features, and the robot's cameras and state parts."""
    inputs = [f"  {name} {feature.kind} {list(feature.shape)}" for name, feature in features.items()]
    cameras = ", ".join(CAMERAS[morphology])
    parts = ", ".join(f"{part} {width}" for part, width in STATE_PARTS[morphology])
    return "\n".join(
        [
            "the checkpoint's input features cannot be provided:",
            *(f"  {problem}" for problem in problems),
            "input features of the checkpoint:",
            *inputs,
            f"cameras of the {morphology} robot: {cameras}",
            f"state parts of the {morphology} robot: {parts}",
            f"define the mapping in {FILE} next to config.json",
        ]
    )
