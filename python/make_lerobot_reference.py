#!/usr/bin/env python3
"""Write tiny LeRobot ACT checkpoints and LeRobot's outputs for them, for policy-host's tests.

    make_lerobot_reference.py OUT

Creates one folder per case in OUT, each with LeRobot's own files and `io.safetensors`: the inputs of the pre-processor,
the chunks returned by the post-processor, and for the case `robot` a whole episode of temporal ensembling.

| case | contents |
|--|--|
| `env_state` | no camera, an environment state, mean/std normalisation |
| `cameras` | two cameras of other sizes, min/max for states and actions, raw images, two decoder layers, no VAE |
| `robot` | the benchmark's single arm: three cameras, 25-wide state, 7-wide action, instruction as environment state |
| `older` | like `cameras`, with the statistics among the weights, as saved by LeRobot before 0.4 |

Weights and inputs are derived from a seed. Needs `lerobot` 0.4 or newer, which depends on torch. The ResNet has only a
few channels, so that a checkpoint stays below 1 MB. The case `robot` also contains the actions for the observations
that `make_act_checkpoint.py` and policy-host's tests generate, with resized images and embedded instructions.
"""

import argparse
import json
import shutil
from pathlib import Path

import torch
import torch.nn.functional as F
import torchvision
from lerobot.configs.types import FeatureType, NormalizationMode, PolicyFeature
from lerobot.policies.act import modeling_act
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy, ACTTemporalEnsembler
from lerobot.policies.factory import make_pre_post_processors
from make_act_checkpoint import INSTRUCTIONS, generated_observation, hashed_embedding
from safetensors.torch import load_file, save_file

STATE, ENV, ACTION = "observation.state", "observation.environment_state", "action"
WIDTH = 8
N_SAMPLES = 3


class NarrowResNet(torchvision.models.ResNet):
    """ResNet-18 with an eighth of its channels."""

    def __init__(self, **kwargs):
        kwargs.pop("weights", None)
        block = torchvision.models.resnet.BasicBlock
        super().__init__(block, [2, 2, 2, 2], **kwargs)
        norm = kwargs["norm_layer"]
        self.inplanes = WIDTH
        self.conv1 = torch.nn.Conv2d(3, WIDTH, 7, 2, 3, bias=False)
        self.bn1 = norm(WIDTH)
        for stage in range(4):
            layer = self._make_layer(block, WIDTH << stage, 2, stride=1 if stage == 0 else 2)
            setattr(self, f"layer{stage + 1}", layer)
        self.fc = torch.nn.Linear(WIDTH << 3, 1)


def feature(kind, *shape):
    return PolicyFeature(type=kind, shape=shape)


def config(inputs, action_dim, chunk, modes, **others):
    small = dict(dim_model=32, n_heads=4, dim_feedforward=48, n_encoder_layers=2, n_vae_encoder_layers=1, latent_dim=4)
    return ACTConfig(
        input_features=inputs,
        output_features={ACTION: feature(FeatureType.ACTION, action_dim)},
        chunk_size=chunk,
        n_action_steps=others.pop("n_action_steps", chunk),
        normalization_mapping={kind: NormalizationMode[mode] for kind, mode in modes.items()},
        pretrained_backbone_weights=None,
        device="cpu",
        **(small | others),
    )


def statistics(features, random):
    """Return random statistics that keep normalised values of order one, like those of a dataset."""
    stats = {}
    for name, feature in features.items():
        shape = (3, 1, 1) if feature.type is FeatureType.VISUAL else feature.shape
        uniform = lambda low, high: low + (high - low) * torch.rand(shape, generator=random)
        mean, std = uniform(-0.3, 0.5), uniform(0.2, 0.8)
        stats[name] = dict(mean=mean, std=std, min=mean - uniform(1, 2), max=mean + uniform(1, 2))
    return stats


def perturb_weights(policy, random):
    """Replace the default batch statistics, biases and scales, which would hide errors in their use."""
    with torch.no_grad():
        for name, tensor in policy.state_dict().items():
            if name.endswith("running_var"):
                tensor.copy_(0.5 + torch.rand(tensor.shape, generator=random))
            elif name.endswith(("running_mean", ".bias")):
                tensor.copy_(0.2 * torch.rand(tensor.shape, generator=random) - 0.1)
            elif name.endswith(".weight") and tensor.dim() == 1:
                tensor.copy_(0.9 + 0.2 * torch.rand(tensor.shape, generator=random))


def sample_inputs(features, random, n):
    """Draw a batch of `n` random inputs: images `[n, 3, height, width] u8`, vectors `[n, dim] f32` in [-1, 1)."""
    inputs = {}
    for name, feature in features.items():
        if feature.type is FeatureType.VISUAL:
            inputs[name] = torch.randint(0, 256, (n, *feature.shape), generator=random, dtype=torch.uint8)
        else:
            inputs[name] = 2 * torch.rand((n, *feature.shape), generator=random) - 1
    return inputs


def observation(features, env):
    """Return the generated observation of an env as input for a LeRobot policy with these features."""
    external, hand, state = generated_observation(env, "single")
    cameras = dict(external1=external[0], external2=external[1], hand=hand[0])
    embedding = hashed_embedding(INSTRUCTIONS[env], features[ENV].shape[0])
    inputs = {STATE: torch.from_numpy(state), ENV: torch.from_numpy(embedding).float()}
    for name, pixels in cameras.items():
        name = f"observation.images.{name}"
        size = features[name].shape[1:]
        image = torch.from_numpy(pixels).permute(2, 0, 1)[None].float()
        image = F.interpolate(image, size, mode="bilinear", antialias=True, align_corners=False)[0]
        inputs[name] = (image + 0.501).floor().clamp(0, 255).to(torch.uint8)
    return inputs


def as_batch(inputs):
    """Scale u8 images to [0, 1]."""
    return {name: x.float() / 255 if x.dtype == torch.uint8 else x for name, x in inputs.items()}


def write(folder, config, seed, episode=0):
    """Write the checkpoint of one case and LeRobot's outputs.

    Args:
        folder: Output folder.
        config: LeRobot's `ACTConfig`.
        seed: Seed of weights, statistics and inputs.
        episode: Length of the ensembled episode, or 0 for none.
    """
    torch.manual_seed(seed)
    random = torch.Generator().manual_seed(seed)
    policy = ACTPolicy(config).eval()
    perturb_weights(policy, random)
    stats = statistics(config.input_features | config.output_features, random)
    preprocess, postprocess = make_pre_post_processors(config, dataset_stats=stats)
    policy.save_pretrained(folder)
    preprocess.save_pretrained(folder)
    postprocess.save_pretrained(folder)
    # The model card is not needed.
    (folder / "README.md").unlink(missing_ok=True)
    out = sample_inputs(config.input_features, random, N_SAMPLES)
    with torch.no_grad():
        out["chunk"] = postprocess(policy.predict_action_chunk(preprocess(as_batch(out))))
        if episode:
            steps = sample_inputs(config.input_features, random, episode)
            ensembler = ACTTemporalEnsembler(config.temporal_ensemble_coeff, config.chunk_size)
            chunks = policy.predict_action_chunk(preprocess(as_batch(steps)))
            rows = [ensembler.update(chunks[step : step + 1].clone()) for step in range(episode)]
            out |= dict(episode_chunks=postprocess(chunks), episode_actions=postprocess(torch.cat(rows)))
            observations = [observation(config.input_features, env) for env in range(2)]
            batch = {name: torch.stack([inputs[name] for inputs in observations]) for name in observations[0]}
            out["actions"] = postprocess(policy.predict_action_chunk(preprocess(as_batch(batch))))
    save_file({name: x.contiguous() for name, x in out.items()}, folder / "io.safetensors")
    return stats


def make_older(source, folder):
    """Copy a checkpoint and move its statistics among the weights, under the names used before LeRobot 0.4."""
    shutil.copytree(source, folder)
    tensors = load_file(folder / "model.safetensors")
    stats = load_file(next(folder.glob("policy_preprocessor_step_*_normalizer_processor.safetensors")))
    modes = json.loads((folder / "config.json").read_text())["normalization_mapping"]
    for name, x in stats.items():
        feature_name, statistic = name.rsplit(".", 1)
        kind = {STATE: "STATE", ACTION: "ACTION"}.get(feature_name, "VISUAL")
        if statistic not in {"MEAN_STD": ("mean", "std"), "MIN_MAX": ("min", "max")}.get(modes[kind], ()):
            continue
        is_action = feature_name == ACTION
        modules = ("normalize_targets", "unnormalize_outputs") if is_action else ("normalize_inputs",)
        for module in modules:
            tensors[f"{module}.buffer_{feature_name.replace('.', '_')}.{statistic}"] = x.clone()
    for path in folder.glob("policy_*"):
        path.unlink()
    save_file(tensors, folder / "model.safetensors")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="output folder")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    # The policy's constructor looks the backbone up by the name in its configuration.
    modeling_act.torchvision.models.resnet18 = NarrowResNet

    mean_std = dict(VISUAL="MEAN_STD", STATE="MEAN_STD", ACTION="MEAN_STD")
    min_max = dict(VISUAL="IDENTITY", STATE="MIN_MAX", ACTION="MIN_MAX")
    state = lambda n: {STATE: feature(FeatureType.STATE, n)}
    env = lambda n: {ENV: feature(FeatureType.ENV, n)}
    camera = lambda name, height, width: {
        f"observation.images.{name}": feature(FeatureType.VISUAL, 3, height, width)
    }
    write(out / "env_state", config(state(9) | env(7), 8, 10, mean_std), 1)
    two = camera("top", 64, 96) | camera("wrist", 33, 48)
    write(out / "cameras", config(two | state(6), 6, 12, min_max, n_decoder_layers=2, use_vae=False), 2)
    make_older(out / "cameras", out / "older")
    three = camera("external1", 96, 96) | camera("external2", 96, 96) | camera("hand", 64, 64)
    write(
        out / "robot",
        config(three | state(25) | env(16), 7, 70, mean_std, temporal_ensemble_coeff=0.05, n_action_steps=1),
        3,
        episode=90,
    )
    (out / "robot" / "hypogeum.json").write_text(
        json.dumps({"language": {"encoder": "hashed", "dim": 16}}, indent=2) + "\n"
    )


if __name__ == "__main__":
    main()
