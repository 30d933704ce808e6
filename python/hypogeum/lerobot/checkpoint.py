"""Loading of LeRobot's checkpoints: configuration, policy, and pre- and post-processor."""

import json
import logging

import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class, make_pre_post_processors

from ..backbone import resnet18_of, width_of
from ..mapping import PROMPT_STATES, MappingError
from ..tokenizer import JSON, SENTENCEPIECE, read_tokenizer

CONFIG, WEIGHTS, PREPROCESSOR = "config.json", "model.safetensors", "policy_preprocessor.json"
# LeRobot's name of the processor step that tokenises instructions.
TOKENIZER = "tokenizer_processor"
# Policies whose network `hypogeum.pi05` builds.
GEMMA = ("pi0", "pi05")

log = logging.getLogger("hypogeum")


def read_config(folder, device):
    """Return LeRobot's configuration of the checkpoint in `folder`, for a torch device."""
    if not (folder / CONFIG).is_file():
        raise MappingError(f"{folder} has no {CONFIG}; expected a folder that LeRobot names pretrained_model")
    try:
        torch.empty(0, device=device)
    # Torch raises other exceptions for a device that it was not built for.
    except Exception as error:
        raise MappingError(f"device {device!r} cannot be used: {error}") from error
    try:
        config = PreTrainedConfig.from_pretrained(folder)
    except Exception as error:
        raise MappingError(f"LeRobot cannot read {folder / CONFIG}: {error}") from error
    config.device = device
    # The first query must be answered within two minutes, and compilation may take longer.
    if getattr(config, "compile_model", False):
        config.compile_model = False
    # SmolVLA's vision-language model and vocabulary may be named by a folder in the checkpoint.
    vlm = getattr(config, "vlm_model_name", None)
    if vlm and (folder / vlm).is_dir():
        config.vlm_model_name = str(folder / vlm)
    return config


def load(folder, config, settings):
    """Load the checkpoint in `folder`.

    Args:
        folder: Checkpoint folder.
        config: LeRobot's configuration.
        settings: Contents of `hypogeum.json`.

    Returns:
        LeRobot's policy, its preprocessor and its postprocessor.

    Raises:
        MappingError: A file is missing or invalid.
    """
    if config.type != "pi05" and "prompt_state" in settings:
        raise MappingError(f"`prompt_state` applies to type 'pi05', the checkpoint has type {config.type!r}")
    try:
        policy = load_policy(folder, config)
        processors = load_processors(folder, config)
    except MappingError:
        raise
    # LeRobot and its dependencies raise many types of exceptions; their messages say what is wrong.
    except Exception as error:
        raise MappingError(f"LeRobot cannot load {folder}: {error}") from error
    if config.type == "pi05":
        from .. import pi05

        convention = settings.get("prompt_state", PROMPT_STATES[0])
        log.info("π0.5 with the state %s in the prompt", convention)
        if convention == "padded":
            pi05.pad_prompt(processors[0], config.max_state_dim)
    return policy, *processors


def load_policy(folder, config):
    """Return LeRobot's policy with the weights in `folder`, in evaluation mode."""
    policy_class = get_policy_class(config.type)
    if config.type in GEMMA:
        from .. import pi05

        return pi05.load(policy_class, folder, config)
    if not (folder / WEIGHTS).is_file():
        raise MappingError(f"{folder} has no {WEIGHTS}")
    with resnet18_of(width_of(folder)):
        try:
            return policy_class.from_pretrained(folder, config=config)
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


def load_processors(folder, config):
    """Return LeRobot's pre- and post-processor with the statistics in `folder`."""
    if not (folder / PREPROCESSOR).is_file():
        raise MappingError(f"{folder} has no {PREPROCESSOR}; convert the checkpoint with LeRobot's migration script")
    overrides = {"device_processor": {"device": config.device}}
    steps = json.loads((folder / PREPROCESSOR).read_text())["steps"]
    for step in steps:
        if step.get("registry_name") == TOKENIZER:
            name = step["config"].get("tokenizer_name")
            overrides[TOKENIZER] = {"tokenizer": load_tokenizer(folder, config, name)}
    return make_pre_post_processors(config, pretrained_path=str(folder), preprocessor_overrides=overrides)


def load_tokenizer(folder, config, name):
    """Return the vocabulary in the checkpoint's folder or, if there is none, the one that LeRobot names."""
    tokenizer = read_tokenizer(folder)
    if tokenizer is None:
        return download_tokenizer(folder, getattr(config, "vlm_model_name", name) or name)
    if config.type in GEMMA:
        from .. import pi05

        n_entries = pi05.widths_of(folder).vocabulary
        if tokenizer.size > n_entries:
            raise MappingError(
                f"the vocabulary in {folder} has {tokenizer.size} tokens, the network's embedding has {n_entries} "
                "entries; copy the tokenizer with which it was trained into the folder"
            )
    return tokenizer


def download_tokenizer(folder, name):
    """Return the tokenizer called `name`, a folder or a repository on the hub."""
    from transformers import AutoTokenizer

    try:
        return AutoTokenizer.from_pretrained(name)
    except Exception as error:
        reason = str(error).split("\n", maxsplit=1)[0]
        raise MappingError(
            f"{folder} has neither {SENTENCEPIECE} nor {JSON}, and the vocabulary {name!r} that LeRobot uses cannot be "
            f"downloaded: {reason}; copy its {SENTENCEPIECE} or {JSON} into the folder"
        ) from error
