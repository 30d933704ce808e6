"""Loading of LeRobot's checkpoints: configuration and policy."""

import json
import logging
import tempfile
import textwrap
from contextlib import contextmanager
from pathlib import Path

import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class
from lerobot.policies.pretrained import PreTrainedPolicy

from ..backbone import resnet18_of, width_of
from ..folder import ADAPTER, CONFIG, JAX, WEIGHTS, resolve_checkpoint
from ..mapping import FILE, MappingError
from ..requirements import explain
from ..weights import load_complete

# Policies whose network `hypogeum.pi05` builds.
GEMMA = ("pi0", "pi05")
# Extra of the package lerobot that a policy type needs, if it is not called like the type.
EXTRAS = {"pi0": "pi", "pi05": "pi", "pi0_fast": "pi", "wall_x": "wallx"}
# Maximum length of the reasons of LeRobot and its dependencies, some of which list everything that they know.
MAX_REASON = 400
BUILT_IN = "serve it with the built-in policy instead: hypogeum run --policy NAME=pi05:"

log = logging.getLogger("hypogeum")


def read_config(folder, device, ignored=()):
    """Return LeRobot's configuration of the checkpoint in `folder`.

    Args:
        folder: Checkpoint folder.
        device: Torch device.
        ignored: Keys of `config.json` to leave out.

    Raises:
        MappingError: The configuration is missing or invalid, or the device cannot be used.
    """
    contents = read_json(folder)
    for key in ignored:
        if key in contents:
            log.warning("%s of %s is ignored, as %s says: %s", key, CONFIG, FILE, json.dumps(contents.pop(key)))
        else:
            log.warning("%s in `ignore` of %s has no effect: %s has no such key", key, FILE, CONFIG)
    try:
        torch.empty(0, device=device)
    # Torch raises other exceptions for a device that it was not built for.
    except Exception as error:
        raise MappingError(f"device {device!r} cannot be used: {error}") from error
    try:
        config = parse_config(contents) if ignored else PreTrainedConfig.from_pretrained(folder)
    except Exception as error:
        advice = f"; use a newer LeRobot, or name them in `ignore` of {FILE} to leave them out"
        is_unknown = "are not valid for" in str(error)
        raise MappingError(f"LeRobot cannot read {folder / CONFIG}: {error}{advice * is_unknown}") from error
    if config.action_feature is None:
        raise MappingError(f"{folder / CONFIG} has no output feature 'action'")
    adapt_config(config, folder, device, contents.get("device"))
    return config


def read_json(folder):
    """Return the contents of `config.json`, which a checkpoint of LeRobot has."""
    if (folder / JAX).is_file():
        raise MappingError(
            f"{folder} is a JAX checkpoint of openpi (it has {JAX}); convert it with openpi's own "
            f"examples/convert_jax_model_to_pytorch.py, then {BUILT_IN}CONVERTED"
        )
    is_openpi = (folder / WEIGHTS).is_file() and (folder / "assets").is_dir()
    if (folder / "single" / CONFIG).is_file() and (folder / "bimanual" / CONFIG).is_file():
        raise MappingError(f"{folder} has a checkpoint for each morphology; serve {folder / 'single'} or the other one")
    if not (folder / CONFIG).is_file() and not is_openpi:
        raise MappingError(f"{folder} has no {CONFIG}; expected a folder that LeRobot names pretrained_model")
    try:
        contents = {} if not (folder / CONFIG).is_file() else json.loads((folder / CONFIG).read_text())
    except ValueError as error:
        raise MappingError(f"{folder / CONFIG} is not valid JSON: {error}") from error
    if not isinstance(contents, dict):
        raise MappingError(f"{folder / CONFIG} contains {type(contents).__name__}, expected an object")
    if "type" not in contents and is_openpi:
        raise MappingError(f"{folder} is a checkpoint of openpi and not of LeRobot; {BUILT_IN}{folder}")
    return contents


def parse_config(contents):
    """Return LeRobot's configuration with these contents of `config.json`."""
    with tempfile.TemporaryDirectory() as copy:
        (Path(copy) / CONFIG).write_text(json.dumps(contents))
        return PreTrainedConfig.from_pretrained(copy)


def adapt_config(config, folder, device, saved_device):
    """Set what depends on this host, and announce every setting that is not as saved."""
    if saved_device not in (None, device):
        log.info("computes on %s; the checkpoint names %s", device, saved_device)
    config.device = device
    # The first query must be answered within two minutes, and compilation may take longer.
    for name in ("compile_model", "compile_action_infer"):
        if getattr(config, name, False):
            log.info("%s of the checkpoint is not used: its network is not compiled", name)
            setattr(config, name, False)
    if config.use_amp:
        log.info("computes under autocast (use_amp of the checkpoint)")
    rtc = getattr(config, "rtc_config", None)
    if getattr(rtc, "enabled", False):
        log.warning(
            "rtc_config of the checkpoint is not used: every chunk is computed on its own, from one observation"
        )
        config.rtc_config = None
    if getattr(config, "per_episode_seed", False):
        log.info("per_episode_seed of the checkpoint is not used: noise depends on the run's own seeds and the query")
        config.per_episode_seed = False
    # SmolVLA's vision-language model and vocabulary may be named by a folder in the checkpoint.
    vlm = getattr(config, "vlm_model_name", None)
    if vlm and (folder / vlm).is_dir():
        config.vlm_model_name = str(folder / vlm)


def weights_folder(folder):
    """Return the folder with the network's weights: `folder`, or that of the base if it contains a LoRA adapter."""
    if not (folder / ADAPTER).is_file():
        return folder
    base = json.loads((folder / ADAPTER).read_text()).get("base_model_name_or_path")
    try:
        if base is None:
            raise MappingError("find out which one that is and download it")
        return resolve_checkpoint(base)
    except MappingError as error:
        raise MappingError(
            f"{folder} contains a LoRA adapter of {base or 'an unnamed base'}: {error}; then set "
            f"base_model_name_or_path in {folder / ADAPTER} to its folder"
        ) from error


def load_policy(folder, config):
    """Return LeRobot's policy with the weights in `folder`, in evaluation mode.

    Raises:
        MappingError: A file or package is missing, or a file is invalid.
    """
    with explained_loading(folder, config.type):
        weights = weights_folder(folder)
        policy = load_weights(weights, config)
        return policy if weights == folder else merge_adapter(policy, folder, weights)


def load_weights(folder, config):
    """Return LeRobot's policy with the weights in `folder`, which contains no adapter."""
    policy_class = get_policy_class(config.type)
    if config.type in GEMMA:
        from .. import pi05

        return pi05.load(policy_class, folder, config)
    if not (folder / WEIGHTS).is_file():
        raise MappingError(f"{folder} has no {WEIGHTS}")
    with resnet18_of(width_of(folder)):
        try:
            if not loads_as_usual(policy_class):
                return policy_class.from_pretrained(folder, config=config)
            # The checkpoint has all weights, so that those with which training began need not be downloaded.
            if getattr(config, "pretrained_backbone_weights", None):
                config.pretrained_backbone_weights = None
            policy = policy_class(config)
        except OSError as error:
            vlm = getattr(config, "vlm_model_name", None)
            if vlm is None:
                raise
            reason = str(error).split("\n", maxsplit=1)[0]
            raise MappingError(
                f"the vision-language model {vlm!r} that LeRobot builds cannot be loaded: {reason}; copy its "
                f"configuration, processor and tokenizer files to {folder / 'vlm'} and set `vlm_model_name` in "
                f'{CONFIG} to "vlm"'
            ) from error
    load_complete(policy, folder / WEIGHTS)
    return policy.to(config.device).eval()


def loads_as_usual(policy_class):
    """Return whether a class reads `model.safetensors` as LeRobot's base class does."""
    owner = {name: cls for cls in reversed(policy_class.__mro__) for name in vars(cls)}
    return all(owner.get(name) is PreTrainedPolicy for name in ("from_pretrained", "_load_as_safetensor"))


def merge_adapter(policy, folder, base):
    """Return a policy with the LoRA adapter in `folder` added to its weights."""
    from peft import PeftModel

    log.info("adds the LoRA adapter in %s to the weights in %s", folder, base)
    return PeftModel.from_pretrained(policy, folder).merge_and_unload().eval()


@contextmanager
def explained_loading(folder, kind):
    """Turn an exception of LeRobot or its dependencies into a `MappingError` about the checkpoint in `folder`."""
    try:
        yield
    except MappingError:
        raise
    except ModuleNotFoundError as error:
        extra = "peft" if error.name == "peft" else EXTRAS.get(kind, kind)
        raise MappingError(explain(error, f"pip install 'lerobot[{extra}]'")) from error
    # They raise many types of exceptions; their messages say what is wrong.
    except Exception as error:
        reason = textwrap.shorten(str(error), MAX_REASON, placeholder=" …")
        raise MappingError(f"LeRobot cannot load {folder}: {reason}") from error
