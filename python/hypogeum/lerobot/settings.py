"""Settings of a checkpoint that this host honours in its own way, refuses or announces."""

import json
import logging
from pathlib import Path

from lerobot import processor

from ..execution import ENSEMBLE, ChunkSettings, Execution, Requested, RunRefused
from ..layout import MORPHOLOGIES
from ..mapping import FILE, Feature, MappingError
from .kinds import READS_ENVIRONMENT_STATE, SHORT_CHUNKS

# Keys of `hypogeum.json` that apply to some policy types only.
APPLY_TO = {"prompt_state": ("pi05",), "vision_heads": ("pi0", "pi05")}
ENVIRONMENT_STATE = "ENV"

log = logging.getLogger("hypogeum")


def check_settings(settings, kind):
    """Raise `MappingError` for a key of `hypogeum.json` that does not apply to the policy's type."""
    for key, kinds in APPLY_TO.items():
        if key in settings and kind not in kinds:
            expected = " or ".join(map(repr, kinds))
            raise MappingError(f"`{key}` in {FILE} applies to type {expected}, the checkpoint has type {kind!r}")
    if "chunk_size" in settings:
        raise MappingError(f"`chunk_size` in {FILE} belongs to openpi's layout, which only the built-in π0.5 reads")


def read_features(config):
    """Return the input `Feature`s that the policy reads, by name."""
    features = {}
    for name, feature in (config.input_features or {}).items():
        kind = feature.type.value
        if kind == ENVIRONMENT_STATE and config.type not in READS_ENVIRONMENT_STATE:
            log.info("%s is left out: policies of type %r do not read it", name, config.type)
            continue
        features[name] = Feature(kind, tuple(feature.shape))
    return features


def pad_prompt(preprocess, config, settings, folder):
    """Write π0.5's prompt by the convention of the checkpoint, and say which one that is. Return whether it is padded.

    It is the one that `hypogeum.json` names, or that of the version of LeRobot that wrote the folder: before 0.5, the
    state was padded and letterbox padding had the value -3.
    """
    from .. import pi05

    convention, evidence = settings.get("prompt_state"), FILE
    if convention is None:
        convention, evidence = written_convention(Path(folder))
    log.info("π0.5 with the state %s in the prompt, because of %s", convention, evidence)
    is_padded = convention == "padded"
    if is_padded:
        pi05.pad_prompt(preprocess, config.max_state_dim)
    return is_padded


def written_convention(folder):
    """Return the convention of the LeRobot that wrote a folder, and the evidence for it."""

    def keys(name):
        path = folder / name
        return json.loads(path.read_text()).keys() if path.is_file() else None

    if "use_relative_actions" in keys("config.json"):
        return "unpadded", "`use_relative_actions` in config.json"
    training = keys("train_config.json")
    if training is None:
        return "padded", "config.json, which has no `use_relative_actions`"
    if "cudnn_deterministic" in training:
        return "unpadded", "`cudnn_deterministic` in train_config.json"
    return "padded", "train_config.json, which has no `cudnn_deterministic`"


def announce_sizes(mapping, sizes):
    """Log the cameras whose training images had a different aspect ratio, or more pixels.

    `sizes` are those of a run, (width, height). Larger images of the same aspect ratio are reduced to the size of
    training.
    """
    cameras = MORPHOLOGIES[mapping.morphology].cameras
    different = []
    for camera, height, width in mapping.images.values():
        own_width, own_height = sizes[cameras.index(camera) >= MORPHOLOGIES[mapping.morphology].n_external_cameras]
        if own_width * height != own_height * width or own_width < width:
            different.append(f"{camera} {own_width}x{own_height} instead of {width}x{height}")
    if different:
        log.warning(
            "resizes images that differ from those of training: %s; choose others with --image-size or --protocol of the run",
            ", ".join(different),
        )


def announce_differences(policy):
    """Log what a `LeRobotPolicy` receives or does otherwise than in training or in LeRobot's own loop."""
    # LeRobot has this step since 0.5.1.
    absolute = getattr(processor, "AbsoluteActionsProcessorStep", ())
    if any(isinstance(step, absolute) and step.enabled for step in policy.postprocess.steps):
        log.info(
            "relative actions are added to the state of their query, as in training; lerobot-eval adds them to the "
            "state of the control step in which they are executed"
        )


def chunk_settings(config):
    """Return the `ChunkSettings` of LeRobot's configuration."""
    # VQ-BeT executes whole chunks.
    n_action_steps = getattr(config, "n_action_steps", None) or getattr(config, "action_chunk_size", None)
    horizon = n_action_steps if config.type in SHORT_CHUNKS else getattr(config, "chunk_size", None)
    return ChunkSettings(n_action_steps, getattr(config, "temporal_ensemble_coeff", None), horizon)


def plan_execution(settings, run, n_obs_steps):
    """Return the `Execution` of a policy that conditions on the last observations.

    Args:
        settings: Its `ChunkSettings`.
        run: The run's `EndpointDescriptor`.
        n_obs_steps: Number of observations.

    Raises:
        RunRefused: The run's defaults are not what the checkpoint says.
    """
    if n_obs_steps > 1 and run.requested == Requested():
        raise RunRefused(
            f"the checkpoint's n_obs_steps is {n_obs_steps}, but this run sends an observation only every "
            f"{run.execute} control steps; add --execute 1 to the run to provide those of every step, as in LeRobot's "
            "own loop, or another number of rows to condition on observations that far apart"
        )
    if run.mode != ENSEMBLE and run.execute == 1:
        rows = settings.n_action_steps
        return Execution(None, f"observes every control step and executes {rows} rows of each chunk (n_action_steps)")
    execution = settings.resolve(run)
    if n_obs_steps > 1 and run.execute > 1:
        apart = f"; it conditions on {n_obs_steps} observations, which are that far apart here, not successive"
        return execution._replace(note=execution.note + apart)
    return execution
