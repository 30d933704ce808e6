"""LeRobot's π0 and π0.5 in other sizes, and the older convention of π0.5's prompt.

LeRobot's configuration names only a variant of Gemma; the widths behind it, the vision tower and the vocabulary are
constants. `narrow` replaces them while a policy is built, and `widths_of` takes them from the tensors of a checkpoint.
"""

import json
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import torch
from lerobot.policies.factory import make_pre_post_processors
from lerobot.policies.pi0 import modeling_pi0
from lerobot.policies.pi05 import modeling_pi05, processor_pi05
from safetensors import SafetensorError, safe_open

from .mapping import FILE, MappingError, read_settings
from .weights import load_tensors, plain_name, report

WEIGHTS, INDEX = "model.safetensors", "model.safetensors.index.json"
STATE, OBSERVATION = "observation.state", "observation"
# SigLIP So400m/14, the vision tower of the published checkpoints, and PaliGemma's vocabulary.
VISION = dict(hidden_size=1152, num_hidden_layers=27, intermediate_size=4304, num_attention_heads=16)
VOCABULARY = 257_152
# Tensors that inference does not read, so that a checkpoint may lack them.
UNUSED = ("gemma_expert.lm_head.weight", "paligemma.lm_head.weight")
_JOINT = "paligemma_with_expert."


@dataclass
class Widths:
    """Sizes of a network, under the names of transformers for the vision tower and of LeRobot for the others."""

    vision: dict
    prefix: dict
    expert: dict
    vocabulary: int


def load(policy_class, folder, config):
    """Load the π0 or π0.5 in `folder`, from one file or several.

    LeRobot's own `from_pretrained` continues with random weights if it fails to load them.

    Raises:
        MappingError: A file or tensor is missing, or tensors have unexpected names or sizes.
    """
    widths = widths_of(folder)
    with nullcontext() if widths == standard_widths(config) else narrow(widths):
        policy = policy_class(config)
    missing, unexpected = set(policy.state_dict()), []
    for path in weight_files(folder):
        tensors = policy._fix_pytorch_state_dict_keys(load_tensors(path), config)
        tensors = {f"model.{name.removeprefix('model.')}": tensor for name, tensor in tensors.items()}
        try:
            unexpected += policy.load_state_dict(tensors, strict=False).unexpected_keys
        except RuntimeError as error:
            raise MappingError(f"{path}: {error}") from error
        missing -= tensors.keys()
    report(folder, sorted(name for name in missing if not name.endswith(UNUSED)), unexpected)
    return policy.eval()


def weight_files(folder):
    """Return the paths of the safetensors files of a checkpoint."""
    folder = Path(folder)
    if (folder / WEIGHTS).is_file():
        return [folder / WEIGHTS]
    if not (folder / INDEX).is_file():
        raise MappingError(f"{folder} has neither {WEIGHTS} nor {INDEX}")
    try:
        names = sorted(set(json.loads((folder / INDEX).read_text())["weight_map"].values()))
    except (ValueError, KeyError, AttributeError) as error:
        raise MappingError(f"{folder / INDEX} is not an index of weights: {error!r}") from error
    for name in names:
        if not (folder / name).is_file():
            raise MappingError(f"{folder} has no {name}, which {INDEX} names")
    return [folder / name for name in names]


def standard_widths(config):
    """Return the `Widths` that LeRobot builds for a configuration."""
    sizes = [vars(modeling_pi05.get_gemma_config(variant)).copy() for variant in variants(config)]
    for size in sizes:
        del size["num_kv_heads"]
    return Widths(VISION, *sizes, VOCABULARY)


def variants(config):
    """Return the names of the variants of Gemma for the prefix and the expert."""
    return config.paligemma_variant, config.action_expert_variant


def widths_of(folder):
    """Return the `Widths` of the checkpoint in `folder`. The number of vision heads is a setting in `hypogeum.json`."""
    shapes = {}
    for path in weight_files(folder):
        try:
            with safe_open(path, "pt") as file:
                for name in file.keys():
                    plain = plain_name(name).removeprefix("model.").removeprefix(_JOINT)
                    shapes[plain] = file.get_slice(name).get_shape()
        except SafetensorError as error:
            raise MappingError(f"{path} is not a safetensors file: {error}") from error
    try:
        vision = vision_widths(shapes, read_settings(folder).get("vision_heads", VISION["num_attention_heads"]))
        embedding = shapes.get("paligemma.model.language_model.embed_tokens.weight")
        vocabulary = (embedding or shapes["paligemma.lm_head.weight"])[0]
        prefix = gemma_widths(shapes, "paligemma.model.language_model")
        expert = gemma_widths(shapes, "gemma_expert.model")
    except KeyError as error:
        raise MappingError(f"the checkpoint in {folder} has no tensor {error.args[0]}") from error
    return Widths(vision, prefix, expert, vocabulary)


def vision_widths(shapes, n_heads):
    """Return the sizes of the vision tower; `shapes` are the tensors' shapes by name."""
    tower = "paligemma.model.vision_tower.vision_model.encoder.layers."
    hidden, width = shapes[f"{tower}0.mlp.fc1.weight"]
    if width % n_heads:
        raise MappingError(
            f"the vision tower has width {width}, which {n_heads} heads do not divide; "
            f"set `vision_heads` in {FILE} to its number of attention heads"
        )
    depth = n_layers(shapes, tower)
    return dict(hidden_size=width, num_hidden_layers=depth, intermediate_size=hidden, num_attention_heads=n_heads)


def gemma_widths(shapes, stack):
    """Return the sizes of a Gemma, which has a single head of keys and values."""
    layers = f"{stack}.layers."
    rows, width = shapes[f"{layers}0.self_attn.q_proj.weight"]
    head_dim = shapes[f"{layers}0.self_attn.k_proj.weight"][0]
    mlp = shapes[f"{layers}0.mlp.gate_proj.weight"][0]
    return dict(width=width, depth=n_layers(shapes, layers), mlp_dim=mlp, num_heads=rows // head_dim, head_dim=head_dim)


def n_layers(shapes, prefix):
    """Return the number of layers whose tensors start with `prefix` and a number."""
    return 1 + max(int(name.removeprefix(prefix).split(".")[0]) for name in shapes if name.startswith(prefix))


@contextmanager
def narrow(widths):
    """Make LeRobot build π0 and π0.5 with these `Widths`, whatever the configuration says."""
    modules = (modeling_pi0, modeling_pi05)
    originals = [(module.get_gemma_config, module.CONFIG_MAPPING) for module in modules]
    for module in modules:
        replace_sizes(module, widths)
    try:
        yield
    finally:
        for module, original in zip(modules, originals):
            module.get_gemma_config, module.CONFIG_MAPPING = original


def replace_sizes(module, widths):
    """Replace the sizes that a modelling module of LeRobot uses to build a policy."""
    gemma_class, mapping = module.GemmaConfig, module.CONFIG_MAPPING
    # A policy asks for the prefix first.
    sizes = iter((widths.prefix, widths.expert))

    def gemma_config(_):
        return gemma_class(**next(sizes), num_kv_heads=1)

    def gemma(**options):
        return mapping["gemma"](**(options | {"vocab_size": widths.vocabulary}))

    def paligemma():
        config = mapping["paligemma"]()
        projection = widths.prefix["width"]
        fix(config.vision_config, **widths.vision, projection_dim=projection)
        fix(config.text_config, vocab_size=widths.vocabulary)
        config.projection_dim = projection
        return config

    module.get_gemma_config = gemma_config
    module.CONFIG_MAPPING = {"gemma": gemma, "paligemma": paligemma}


def fix(config, **values):
    """Set attributes of a configuration and ignore what is assigned to them afterwards."""
    for name, value in values.items():
        setattr(config, name, value)
    cls = type(config)

    def assign(self, name, value):
        if name not in values:
            cls.__setattr__(self, name, value)

    config.__class__ = type(cls.__name__, (cls,), {"__setattr__": assign})


class PaddedPrompt(processor_pi05.Pi05PrepareStateTokenizerProcessorStep):
    """Step that writes π0.5's prompt as LeRobot did before 0.5, with the state padded to `max_state_dim` numbers."""

    def __call__(self, transition):
        observation = transition[OBSERVATION]
        state = modeling_pi05.pad_vector(observation[STATE], self.max_state_dim)
        padded = super().__call__(transition | {OBSERVATION: observation | {STATE: state}})
        return padded | {OBSERVATION: observation}


def pad_prompt(preprocess, max_state_dim):
    """Replace the prompt step of a preprocessor by `PaddedPrompt`."""

    def padded(step):
        if not isinstance(step, processor_pi05.Pi05PrepareStateTokenizerProcessorStep):
            return step
        return PaddedPrompt(**(vars(step) | {"max_state_dim": max_state_dim}))

    preprocess.steps = [padded(step) for step in preprocess.steps]


def scale_padding_twice(policy):
    """Letterbox the images of a policy with -3, as LeRobot before 0.5 did."""
    preprocess, original = policy._preprocess_images, modeling_pi05.resize_with_pad_torch

    def resize(images, *size):
        inside = original(torch.ones_like(images), *size)
        # In [0, 1]; the network's input is scaled to [-1, 1] afterwards.
        return original(images, *size).masked_fill(inside == 0, -1.0)

    def with_padding(batch):
        modeling_pi05.resize_with_pad_torch = resize
        try:
            return preprocess(batch)
        finally:
            modeling_pi05.resize_with_pad_torch = original

    policy._preprocess_images = with_padding


def processors_of(config, stats, tokenizer):
    """Return LeRobot's pre- and post-processor for these statistics, with a `Tokenizer` instead of the hub's."""
    original = processor_pi05.TokenizerProcessorStep

    def with_ours(tokenizer_name=None, **options):
        step = original(tokenizer=tokenizer, **options)
        step.tokenizer_name = tokenizer_name
        return step

    processor_pi05.TokenizerProcessorStep = with_ours
    try:
        return make_pre_post_processors(config, dataset_stats=stats)
    finally:
        processor_pi05.TokenizerProcessorStep = original
