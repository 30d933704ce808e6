"""Copies of LeRobot's policies in this process, for an evaluation in the middle of a training."""

import shutil
from contextlib import AbstractContextManager
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from ..mapping import MappingError
from .policy import LeRobotPolicy
from .processors import POSTPROCESSOR, PREPROCESSOR

# Files that the network saves itself, and an adapter, which has been added to its weights.
WEIGHTS = ("model*.safetensors*", "adapter_*")


def copy_of(policy, *processors) -> LeRobotPolicy:
    """Return a `LeRobotPolicy` with a copy of a policy, on its device and in evaluation mode.

    The policy is saved to a temporary folder with its processors, and loaded as `python -m hypogeum.lerobot` loads a
    checkpoint. So it needs that space on the disk and, until the copy is dropped, its memory a second time. Other files
    of the folder that its `config.pretrained_path` names, such as `hypogeum.json` and a tokenizer, are taken over.

    Args:
        policy: LeRobot's `PreTrainedPolicy`.
        processors: Its preprocessor and postprocessor, or nothing: then those of that folder.

    Raises:
        MappingError: There are no processors, or the policy does not fit the benchmark.
    """
    if len(processors) not in (0, 2):
        raise MappingError(
            f"found a policy with {len(processors)} processors, expected (policy, preprocessor, postprocessor)"
        )
    with TemporaryDirectory(prefix="hypogeum-") as folder:
        source = Path(getattr(policy.config, "pretrained_path", None) or folder)
        if source.is_dir() and source != Path(folder):
            shutil.copytree(source, folder, ignore=shutil.ignore_patterns(*WEIGHTS), dirs_exist_ok=True)
        policy.save_pretrained(folder)
        for processor in processors:
            processor.save_pretrained(folder)
        if not all(Path(folder, name).is_file() for name in (PREPROCESSOR, POSTPROCESSOR)):
            raise MappingError(
                "a policy without processors does not know the statistics of its training; evaluate the tuple (policy, "
                "preprocessor, postprocessor)"
            )
        return LeRobotPolicy(folder, str(next(policy.parameters()).device))


def keep_random_state() -> AbstractContextManager:
    """Return a context that restores torch's generators, because a policy seeds them for the noise of each query."""
    return torch.random.fork_rng(devices=range(torch.cuda.device_count()))
