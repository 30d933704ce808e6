"""Location of a checkpoint: the folder that a user means by a path, by the rules of the built-in policies."""

import logging
import re
from pathlib import Path

from .mapping import MappingError

CONFIG, WEIGHTS, INDEX, ADAPTER = (
    "config.json",
    "model.safetensors",
    "model.safetensors.index.json",
    "adapter_config.json",
)
# File of a checkpoint in JAX's format, as openpi writes it.
JAX = "params/_METADATA"
PRETRAINED = "pretrained_model"
HUB_ID = re.compile(r"[A-Za-z0-9][\w.-]*/[\w.-]+")

log = logging.getLogger("hypogeum")


def resolve_checkpoint(path):
    """Return the checkpoint folder that `path` means, without symbolic links; announce it if it is another one.

    A folder written by `lerobot-train` stands for its last checkpoint.

    Raises:
        MappingError: There is no such folder.
    """
    text = str(path)
    typed = Path.home() / text[2:] if text == "~" or text.startswith("~/") else Path(text)
    if not typed.exists():
        if HUB_ID.fullmatch(text):
            raise MappingError(
                f"there is no folder {text}; if it is a repository on the hub, download it first: "
                f"hf download {text} --local-dir {typed.name}"
            )
        raise MappingError(f"{typed} does not exist")
    if not typed.is_dir():
        raise MappingError(f"{typed} is a file, expected the folder that contains {CONFIG} and {WEIGHTS}")
    folder = find_checkpoint(typed).resolve()
    if folder != typed.absolute():
        log.info("%s is %s", text, folder)
    return folder


def find_checkpoint(folder):
    """Return the checkpoint in a folder of a training run, or `folder` if there is none."""
    candidates = (folder / PRETRAINED, folder / "checkpoints/last" / PRETRAINED, folder / "last" / PRETRAINED)
    for candidate in (folder, *candidates):
        if holds_checkpoint(candidate):
            return candidate
    checkpoints = folder / "checkpoints" if (folder / "checkpoints").is_dir() else folder
    numbered = [step for step in checkpoints.iterdir() if step.name.isdecimal() and (step / PRETRAINED).is_dir()]
    return max(numbered, key=lambda step: int(step.name)) / PRETRAINED if numbered else folder


def holds_checkpoint(folder):
    return any((folder / name).is_file() for name in (CONFIG, WEIGHTS, INDEX, ADAPTER, JAX))
