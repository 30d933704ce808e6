"""Tiny LeRobot checkpoints with random weights, written without a hub. Needs `lerobot[pi,smolvla,diffusion]`."""

import json

import torch
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig
from lerobot.policies.diffusion.modeling_diffusion import DiffusionPolicy
from lerobot.policies.factory import make_pre_post_processors
from lerobot.policies.pi0 import processor_pi0
from lerobot.policies.pi0.configuration_pi0 import PI0Config
from lerobot.policies.pi0.modeling_pi0 import PI0Policy
from lerobot.policies.smolvla.configuration_smolvla import SmolVLAConfig
from lerobot.policies.smolvla.modeling_smolvla import SmolVLAPolicy
from safetensors.torch import load_file, save_file
from tokenizers import Tokenizer, models, pre_tokenizers, trainers
from transformers import (
    PreTrainedTokenizerFast,
    SmolVLMConfig,
    SmolVLMImageProcessor,
    SmolVLMProcessor,
    SmolVLMVideoProcessor,
)

import make_pi05_reference as reference
from hypogeum import tokenizer
from hypogeum.backbone import resnet18_of
from hypogeum.pi05 import narrow
from make_act_checkpoint import INSTRUCTIONS

STATE, ACTION, HAND = "observation.state", "action", "observation.images.hand"
N_ROWS, ACTION_DIM = 8, 7
SPECIAL = {
    "pad": "<|im_end|>", "fake_image_token": "<fake_token_around_image>", "image_token": "<image>",
    "global_image_token": "<global-img>", "end_of_utterance_token": "<end_of_utterance>",
}  # fmt: skip


def features(side, n_cameras=2):
    """Return input and output features of a policy for the single arm."""
    cameras = ("observation.images.external1", HAND)[-n_cameras:]
    images = {name: PolicyFeature(FeatureType.VISUAL, (3, side, side)) for name in cameras}
    inputs = images | {STATE: PolicyFeature(FeatureType.STATE, (25,))}
    return dict(input_features=inputs, output_features={ACTION: PolicyFeature(FeatureType.ACTION, (ACTION_DIM,))})


def statistics(config, random):
    """Return random statistics of every kind that keep values of order one."""
    stats = {}
    for name, feature in (config.input_features | config.output_features).items():
        shape = (3, 1, 1) if feature.type is FeatureType.VISUAL else feature.shape
        mean, spread = torch.rand(shape, generator=random) - 0.5, 0.5 + torch.rand(shape, generator=random)
        stats[name] = dict(mean=mean, std=spread, min=mean - spread, max=mean + spread)
    return stats


def save(folder, policy, processors, settings=None):
    policy.save_pretrained(folder)
    for processor in processors:
        processor.save_pretrained(folder)
    if settings:
        (folder / "hypogeum.json").write_text(json.dumps(settings))
    return folder


def pi05(folder):
    config = reference.config([("external1", 224), ("hand", 128)], 25, ACTION_DIM, max_action_dim=ACTION_DIM)
    return gemma(folder, config, reference.PI05Policy, reference.processors_of)


def pi0(folder):
    config = PI0Config(
        **features(128), chunk_size=N_ROWS, n_action_steps=N_ROWS, image_resolution=(56, 56), device="cpu",
    )  # fmt: skip

    def processors_of(config, stats, pieces):
        original = processor_pi0.TokenizerProcessorStep

        def step(tokenizer_name, **options):
            made = original(tokenizer=pieces, **options)
            made.tokenizer, made.tokenizer_name = None, tokenizer_name
            return made

        processor_pi0.TokenizerProcessorStep = step
        try:
            return make_pre_post_processors(config, dataset_stats=stats)
        finally:
            processor_pi0.TokenizerProcessorStep = original

    return gemma(folder, config, PI0Policy, processors_of)


def gemma(folder, config, policy_class, processors_of):
    """Write a π0 or π0.5 with the widths of the reference cases."""
    random = torch.Generator().manual_seed(1)
    with narrow(reference.WIDTHS):
        policy = policy_class(config)
    reference.randomise(policy, random)
    model = reference.train_tokenizer()
    stats = statistics(config, random)
    for name, values in reference.statistics(config.input_features | config.output_features, random).items():
        stats[name] |= values
    save(
        folder, policy, processors_of(config, stats, tokenizer.Tokenizer.from_sentencepiece(model)), {"vision_heads": 3}
    )
    (folder / tokenizer.SENTENCEPIECE).write_bytes(model)
    return folder


def smolvla(folder):
    """Write a SmolVLA whose vision-language model is described in the checkpoint's folder `vlm`."""
    vlm = folder / "vlm"
    pieces = Tokenizer(models.BPE())
    pieces.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    alphabet = pre_tokenizers.ByteLevel.alphabet()
    trainer = trainers.BpeTrainer(vocab_size=300, special_tokens=list(SPECIAL.values()), initial_alphabet=alphabet)
    pieces.train_from_iterator(INSTRUCTIONS, trainer)
    extra = {name: token for name, token in SPECIAL.items() if name != "pad"}
    tokens = PreTrainedTokenizerFast(
        tokenizer_object=pieces, pad_token=SPECIAL["pad"], eos_token=SPECIAL["end_of_utterance_token"],
        extra_special_tokens=extra,
    )  # fmt: skip
    SmolVLMProcessor(SmolVLMImageProcessor(), tokens, SmolVLMVideoProcessor()).save_pretrained(vlm)
    text = dict(
        model_type="llama", vocab_size=len(tokens), hidden_size=32, intermediate_size=64, num_hidden_layers=2,
        num_attention_heads=4, num_key_value_heads=2, head_dim=8, pad_token_id=0,
    )  # fmt: skip
    vision = dict(
        hidden_size=24, intermediate_size=40, num_hidden_layers=2, num_attention_heads=3, image_size=64, patch_size=16
    )
    SmolVLMConfig(text_config=text, vision_config=vision, scale_factor=2, image_token_id=2).save_pretrained(vlm)
    config = SmolVLAConfig(
        **features(128), vlm_model_name=str(vlm), num_vlm_layers=2, chunk_size=N_ROWS, n_action_steps=N_ROWS,
        resize_imgs_with_padding=(64, 64), device="cpu",
    )  # fmt: skip
    torch.manual_seed(2)
    policy = SmolVLAPolicy(config)
    random = torch.Generator().manual_seed(2)
    save(folder, policy, make_pre_post_processors(config, dataset_stats=statistics(config, random)))
    written = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps(written | {"vlm_model_name": "vlm"}))
    return folder


def diffusion(folder, **others):
    options = dict(
        n_obs_steps=3, n_action_steps=4, horizon=16, down_dims=(16, 32), diffusion_step_embed_dim=16,
        spatial_softmax_num_keypoints=4, num_inference_steps=3, pretrained_backbone_weights=None,
        use_separate_rgb_encoder_per_camera=False, device="cpu",
    )  # fmt: skip
    config = DiffusionConfig(**features(64), **(options | others))
    torch.manual_seed(3)
    policy = DiffusionPolicy(config)
    random = torch.Generator().manual_seed(3)
    return save(folder, policy, make_pre_post_processors(config, dataset_stats=statistics(config, random)))


def act(folder, inputs=None, **others):
    """Write an ACT that is not one of `KINDS`, with more `inputs` if given."""
    options = dict(
        chunk_size=N_ROWS, n_action_steps=N_ROWS // 2, dim_model=16, n_heads=2, dim_feedforward=32, n_encoder_layers=1,
        use_vae=False, pretrained_backbone_weights=None, device="cpu",
    )  # fmt: skip
    given = features(64)
    config = ACTConfig(**(given | {"input_features": given["input_features"] | (inputs or {})}), **(options | others))
    torch.manual_seed(4)
    with resnet18_of(8):
        policy = ACTPolicy(config)
    random = torch.Generator().manual_seed(4)
    return save(folder, policy, make_pre_post_processors(config, dataset_stats=statistics(config, random)))


KINDS = {"pi05": pi05, "pi0": pi0, "smolvla": smolvla, "diffusion": diffusion}


def rewrite(path, change):
    contents = json.loads(path.read_text())
    change(contents)
    path.write_text(json.dumps(contents))


def configure(folder, **values):
    rewrite(folder / "config.json", lambda contents: contents.update(values))


def configure_step(folder, processor, name, change):
    """Change the entry of a processor's step."""

    def apply(contents):
        change(next(step for step in contents["steps"] if step["registry_name"] == name))

    rewrite(folder / f"{processor}.json", apply)


def state_of(folder, processor):
    (path,) = folder.glob(f"{processor}_step_*normalizer_processor.safetensors")
    return path


def change_statistics(processor, change):
    def apply(folder):
        path = state_of(folder, processor)
        save_file(change(load_file(path)), path)

    return apply


def setting(**values):
    return lambda folder: (folder / "hypogeum.json").write_text(json.dumps(values))
