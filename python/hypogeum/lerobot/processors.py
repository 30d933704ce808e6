"""Loading of LeRobot's pre- and post-processor, and what they say about a checkpoint's inputs."""

import json

from lerobot.policies.factory import make_pre_post_processors
from lerobot.processor import NormalizerProcessorStep, RenameObservationsProcessorStep, UnnormalizerProcessorStep

from ..mapping import MappingError
from ..tokenizer import JSON, SENTENCEPIECE, read_tokenizer
from .checkpoint import GEMMA, explained_loading, weights_folder
from .normalisation import check_statistics

PREPROCESSOR, POSTPROCESSOR = "policy_preprocessor.json", "policy_postprocessor.json"
# LeRobot's name of the processor step that tokenises instructions.
TOKENIZER = "tokenizer_processor"
# Statistic by which `hypogeum demos` records that a feature is the hashed embedding of the instruction.
HASHED = "hashed"


class Processors:
    """LeRobot's pre- and post-processor of a checkpoint.

    Args:
        folder: Checkpoint folder.
        config: LeRobot's configuration.

    Raises:
        MappingError: A file is missing or invalid.
    """

    def __init__(self, folder, config):
        self.steps = {name: read_steps(folder, name) for name in (PREPROCESSOR, POSTPROCESSOR)}
        overrides = {"device_processor": {"device": config.device}}
        with explained_loading(folder, config.type):
            for step in self.steps[PREPROCESSOR]:
                if step.get("registry_name") == TOKENIZER:
                    name = step.get("config", {}).get("tokenizer_name")
                    overrides[TOKENIZER] = {"tokenizer": load_tokenizer(folder, config, name)}
            self.preprocess, self.postprocess = make_pre_post_processors(
                config, pretrained_path=str(folder), preprocessor_overrides=overrides
            )

    def take_rename_map(self):
        """Return the saved names of features by their names in the environment, and rename no longer."""
        rename_map = {}
        for step in self.preprocess.steps:
            if isinstance(step, RenameObservationsProcessorStep):
                found = step.rename_map or {}
                if not isinstance(found, dict) or not all(isinstance(name, str) for name in found.values()):
                    raise MappingError(f"rename_map in {PREPROCESSOR} is {found!r}, expected names by names")
                rename_map |= found
                step.rename_map = {}
        return rename_map

    def hashed_features(self):
        """Return the names of the features recorded as hashed embeddings of the instruction."""
        steps = [step for step in self.preprocess.steps if isinstance(step, NormalizerProcessorStep)]
        return {name for step in steps for name, values in (step.stats or {}).items() if HASHED in values}

    def check_statistics(self, config, inputs):
        """Raise `MappingError` if LeRobot would leave out a normalisation for which statistics are missing.

        Args:
            config: LeRobot's configuration.
            inputs: Names of the input features that the preprocessor receives.
        """
        modes = {kind: mode.value for kind, mode in config.normalization_mapping.items()}
        features = {name: (feature.type.value, feature.shape) for name, feature in config.input_features.items()}
        inputs = {name: feature for name, feature in features.items() if name in inputs}
        normalisers = self._labelled(PREPROCESSOR, self.preprocess, NormalizerProcessorStep)
        check_statistics(PREPROCESSOR, normalisers, inputs, modes)
        actions = {"action": ("ACTION", config.action_feature.shape)}
        unnormalisers = self._labelled(POSTPROCESSOR, self.postprocess, UnnormalizerProcessorStep)
        check_statistics(POSTPROCESSOR, unnormalisers, actions, modes)

    def _labelled(self, file, pipeline, step_class):
        """Return the steps of a class, with their names and state files."""
        saved = self.steps[file]
        labelled = []
        for idx, step in enumerate(pipeline.steps):
            if isinstance(step, step_class):
                entry = saved[idx] if idx < len(saved) else {}
                state = entry.get("state_file")
                name = entry.get("registry_name", step_class.__name__)
                labelled.append((f"step {idx} ({name}, {state or 'without a state_file'})", step))
        return labelled


def read_steps(folder, name):
    """Return the steps that a processor's file lists."""
    path = folder / name
    if not path.is_file():
        raise MappingError(f"{folder} has no {name}; convert the checkpoint with LeRobot's migration script")
    try:
        steps = json.loads(path.read_text())["steps"]
    except (ValueError, KeyError, TypeError) as error:
        raise MappingError(f"{path} is not a processor of LeRobot: {error!r}") from error
    if not isinstance(steps, list) or not all(isinstance(step, dict) for step in steps):
        raise MappingError(f"{path} is not a processor of LeRobot: `steps` is not a list of objects")
    return steps


def load_tokenizer(folder, config, name):
    """Return the vocabulary in the checkpoint's folder or, if there is none, the one that LeRobot names."""
    weights = weights_folder(folder)
    # LeRobot after 0.6.1 names a folder in the checkpoint.
    places = [folder, *([folder / name] if name else []), weights]
    tokenizer = next((found for found in map(read_tokenizer, places) if found is not None), None)
    if tokenizer is None:
        return download_tokenizer(folder, getattr(config, "vlm_model_name", name) or name)
    if config.type in GEMMA:
        from .. import pi05

        n_entries = pi05.widths_of(weights).vocabulary
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
