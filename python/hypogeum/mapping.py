"""Which of our cameras and state parts a checkpoint's input features are fed from.

What a checkpoint says of itself decides; `hypogeum.json` beside its `config.json` says the rest, all keys optional:

    {"morphology": "single", "control_mode": "pd_ee_delta_pose",
     "mapping": {"observation.images.front": "external1_camera", "observation.state": ["qpos", "tcp_pose"],
                 "observation.environment_state": "language"},
     "language": {"encoder": "hashed", "dim": 512}}
"""

import json
from dataclasses import dataclass
from pathlib import Path

from .layout import CONTROL_MODES, MORPHOLOGIES
from .robot import CAMERAS, STATE_PARTS, state_slice

FILE = "hypogeum.json"
IMAGES, STATE = "observation.images.", "observation.state"
# What the instruction's embedding is called in a mapping.
LANGUAGE = "language"
ENCODERS = ("hashed",)
# Features that a policy fills in itself when they are missing.
EMPTY_CAMERA = ".empty_camera_"
# Robot and control mode of an action width, if nobody says otherwise.
BY_ACTION_DIM = {
    7: ("single", "pd_ee_delta_pose"),
    8: ("single", "pd_joint_pos"),
    14: ("bimanual", "pd_ee_delta_pose"),
    16: ("bimanual", "pd_joint_pos"),
}


class MappingError(ValueError):
    """A checkpoint that cannot be fed, or whose actions cannot be executed."""


@dataclass(frozen=True)
class Feature:
    """An input of a checkpoint."""

    kind: str
    """"VISUAL", "STATE" or "ENV", as LeRobot calls them."""
    shape: tuple


@dataclass(frozen=True)
class Mapping:
    """What a checkpoint is fed with."""

    morphology: str
    control_mode: str
    images: dict
    """Camera, height and width by feature."""
    states: dict
    """Slices of the state vector by feature."""
    languages: dict
    """Width of the instruction's embedding by feature."""


def read_settings(folder):
    """What `hypogeum.json` in a checkpoint's folder says; nothing if there is none."""
    path = Path(folder) / FILE
    if not path.is_file():
        return {}
    try:
        settings = json.loads(path.read_text())
    except ValueError as error:
        raise MappingError(f"{path} is not JSON: {error}") from error
    unknown = set(settings) - {"morphology", "control_mode", "mapping", "language"}
    if unknown:
        raise MappingError(f"{path} has unknown keys {sorted(unknown)}")
    return settings


def make_mapping(features, action_dim, settings):
    """The `Mapping` of a checkpoint: its input `Feature`s by name, the width of its actions, and `hypogeum.json`."""
    morphology, control_mode = robot(action_dim, settings)
    problems = []
    images, states, languages = {}, {}, {}
    sources = settings.get("mapping", {})
    for name in sources.keys() - features.keys():
        problems.append(f"{name}: {FILE} maps it, the checkpoint does not have it")
    for name, feature in features.items():
        source = sources.get(name)
        if source is None and EMPTY_CAMERA in name:
            continue
        try:
            if feature.kind == "VISUAL":
                images[name] = image_source(name, feature, source, morphology)
            elif feature.kind == "STATE":
                states[name] = state_source(name, feature, source, morphology)
            elif feature.kind == "ENV" and source in (None, LANGUAGE):
                languages[name] = language_width(feature, settings)
            else:
                raise ValueError(f'it can only be mapped to "{LANGUAGE}"')
        except ValueError as problem:
            problems.append(f"{name}: {problem}")
    if problems:
        raise MappingError(both_sides(problems, features, morphology))
    return Mapping(morphology, control_mode, images, states, languages)


def robot(action_dim, settings):
    """Morphology and control mode of the checkpoint's actions."""
    known = BY_ACTION_DIM.get(action_dim, (None, None))
    morphology = settings.get("morphology", known[0])
    if morphology not in MORPHOLOGIES:
        raise MappingError(
            f"the checkpoint's actions have {action_dim} numbers and `morphology` is {morphology!r}, "
            f"expected {' or '.join(MORPHOLOGIES)}; set it in {FILE}"
        )
    widths = MORPHOLOGIES[morphology].action_dim
    control_mode = settings.get("control_mode", known[1])
    if widths.get(control_mode) != action_dim:
        modes = ", ".join(f"{mode} {widths[mode]}" for mode in CONTROL_MODES)
        raise MappingError(
            f"the checkpoint's actions have {action_dim} numbers, which does not fit control mode {control_mode!r} of "
            f"a {morphology} robot ({modes}); set `morphology` and `control_mode` in {FILE}"
        )
    return morphology, control_mode


def image_source(name, feature, source, morphology):
    """Camera, height and width."""
    cameras = CAMERAS[morphology]
    short = name.removeprefix(IMAGES) if source is None else source
    candidates = [short, f"{short}_camera"]
    camera = next((camera for camera in candidates if camera in cameras), None)
    if camera is None:
        raise ValueError(f"no camera is called {' or '.join(map(repr, candidates))}")
    if len(feature.shape) != 3 or feature.shape[0] != 3:
        raise ValueError("images of ours have 3 channels, in front")
    return camera, feature.shape[1], feature.shape[2]


def state_source(name, feature, source, morphology):
    """Slices of the state vector."""
    width, state_dim = feature.shape[0], MORPHOLOGIES[morphology].state_dim
    parts = dict(STATE_PARTS[morphology])
    if source is None and name == STATE:
        defaults = [list(parts), ["qpos"], ["qpos", "qvel"]]
        source = next((names for names in defaults if sum(parts[part] for part in names) == width), None)
    if isinstance(source, str):
        source = [source]
    if not isinstance(source, list):
        raise ValueError(f"map it to a list of state parts that have {width} numbers (the whole state has {state_dim})")
    slices = [state_slice(morphology, part) for part in source]
    found = sum(part.stop - part.start for part in slices)
    if found != width:
        raise ValueError(f"{' + '.join(source)} have {found} numbers, it has {width}")
    return slices


def language_width(feature, settings):
    """Width of the embedding."""
    language = settings.get("language")
    if not isinstance(language, dict) or language.get("encoder") not in ENCODERS:
        needed = {"language": {"encoder": ENCODERS[0], "dim": feature.shape[0]}}
        raise ValueError(f'"language" needs {json.dumps(needed)} in {FILE}')
    if (language.get("dim"),) != tuple(feature.shape):
        raise ValueError(f"`language.dim` is {language.get('dim')}, it has {feature.shape[0]} numbers")
    return feature.shape[0]


def both_sides(problems, features, morphology):
    """An error that names everything on either side."""
    theirs = [f"  {name} {feature.kind} {list(feature.shape)}" for name, feature in features.items()]
    ours = ", ".join(CAMERAS[morphology])
    parts = ", ".join(f"{part} {width}" for part, width in STATE_PARTS[morphology])
    return "\n".join(
        [
            "cannot feed the checkpoint:",
            *(f"  {problem}" for problem in problems),
            "its input features:",
            *theirs,
            f"the {morphology} robot's cameras: {ours}",
            f"its state parts: {parts}",
            f"say in {FILE} beside config.json which feature is which",
        ]
    )
