#!/usr/bin/env python3
"""Write a randomly initialised ACT checkpoint that `act:PATH` can load, and PyTorch's outputs for it.

The network is the benchmark's ACT: a ResNet-18 with frozen batch normalisation and a DETR-style transformer with an
instruction token, which outputs an action chunk. Needs `torch`, `numpy` and `safetensors`.

    make_act_checkpoint.py OUT --morphology single            write a full-size checkpoint
    make_act_checkpoint.py OUT --morphology single --tiny     write a checkpoint of a few hundred kB
    ... --rule             compute the weights from tensor names, like policy-host's `synthetic` module
    ... --reference FILE   also write PyTorch's actions for two generated observations, as safetensors
    ... --no-weights       write only the reference, for networks whose weights `--rule` can reproduce

The checkpoints in `policy-host/tests/data/act-tiny` were made with `--tiny --lean --reference
OUT/reference.safetensors`, the bimanual one additionally with `--statistics --seed 1`.
"""

import argparse
import json
import math
import re
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from safetensors.torch import save_file
from torch import nn

from hypogeum.generated import sym, unit
from hypogeum.language import hashed_embedding

ROBOTS = {
    "single": dict(control_mode="pd_ee_delta_pose", state_dim=25, action_dim=7, n_cameras=3),
    "bimanual": dict(control_mode="pd_joint_pos", state_dim=64, action_dim=16, n_cameras=4),
}
FULL = dict(
    num_queries=30, hidden_dim=512, dim_feedforward=1600, nheads=8, enc_layers=4, dec_layers=7,
    backbone="resnet18", backbone_width=64, language=dict(encoder="hashed", dim=512),
)
TINY = dict(
    FULL, hidden_dim=64, dim_feedforward=128, nheads=4, enc_layers=2, dec_layers=1, backbone_width=4,
    language=dict(encoder="hashed", dim=64),
)
LATENT_DIM = 32
EXTERNAL_SIDE, HAND_SIDE = 224, 128
# An empty instruction is evaluated without a language token.
INSTRUCTIONS = ["Raise the red cube above the table.", ""]


def generated_tensor(name, shape):
    """Return the f32 weights that `--rule` assigns to a tensor, a function of its name and shape."""
    if name.endswith("running_var"):
        return 1 + sym(name, shape, 0.5)
    if name.endswith("running_mean"):
        return sym(name, shape, 0.1)
    if len(shape) == 2 and "embed" in name:
        return sym(name, shape, 1)
    if len(shape) == 1:
        return 1 + sym(name, shape, 0.1) if name.endswith("weight") else sym(name, shape, 0.05)
    return sym(name, shape, math.sqrt(3 / math.prod(shape[1:])))


# --- Network ----------------------------------------------------------------------------------------

class FrozenBatchNorm(nn.Module):
    def __init__(self, width):
        super().__init__()
        for name, value in (("weight", 1.0), ("bias", 0.0), ("running_mean", 0.0), ("running_var", 1.0)):
            self.register_buffer(name, torch.full((width,), value))

    def forward(self, x):
        return F.batch_norm(x, self.running_mean, self.running_var, self.weight, self.bias, eps=1e-5)


class Block(nn.Module):
    def __init__(self, n_in, n_out, stride):
        super().__init__()
        self.conv1 = nn.Conv2d(n_in, n_out, 3, stride, 1, bias=False)
        self.bn1 = FrozenBatchNorm(n_out)
        self.conv2 = nn.Conv2d(n_out, n_out, 3, 1, 1, bias=False)
        self.bn2 = FrozenBatchNorm(n_out)
        if stride != 1:
            self.downsample = nn.Sequential(nn.Conv2d(n_in, n_out, 1, stride, bias=False), FrozenBatchNorm(n_out))

    def forward(self, x):
        y = self.bn2(self.conv2(F.relu(self.bn1(self.conv1(x)))))
        return F.relu(y + (self.downsample(x) if hasattr(self, "downsample") else x))


class ResNet18(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.conv1 = nn.Conv2d(3, width, 7, 2, 3, bias=False)
        self.bn1 = FrozenBatchNorm(width)
        n_in = width
        for stage in range(4):
            n_out = width << stage
            blocks = nn.Sequential(Block(n_in, n_out, 1 if stage == 0 else 2), Block(n_out, n_out, 1))
            setattr(self, f"layer{stage + 1}", blocks)
            n_in = n_out

    def forward(self, x):
        x = F.max_pool2d(F.relu(self.bn1(self.conv1(x))), 3, 2, 1)
        return self.layer4(self.layer3(self.layer2(self.layer1(x))))


class EncoderLayer(nn.Module):
    def __init__(self, c):
        super().__init__()
        d = c["hidden_dim"]
        self.self_attn = nn.MultiheadAttention(d, c["nheads"], batch_first=True)
        self.linear1, self.linear2 = nn.Linear(d, c["dim_feedforward"]), nn.Linear(c["dim_feedforward"], d)
        self.norm1, self.norm2 = nn.LayerNorm(d), nn.LayerNorm(d)

    def feed_forward(self, x):
        return self.linear2(F.relu(self.linear1(x)))

    def forward(self, x, position):
        query = x + position
        x = self.norm1(x + self.self_attn(query, query, x, need_weights=False)[0])
        return self.norm2(x + self.feed_forward(x))


class DecoderLayer(EncoderLayer):
    def __init__(self, c):
        super().__init__(c)
        self.multihead_attn = nn.MultiheadAttention(c["hidden_dim"], c["nheads"], batch_first=True)
        self.norm3 = nn.LayerNorm(c["hidden_dim"])

    def forward(self, target, memory, position, query_position):
        query = target + query_position
        target = self.norm1(target + self.self_attn(query, query, target, need_weights=False)[0])
        query, key = target + query_position, memory + position
        target = self.norm2(target + self.multihead_attn(query, key, memory, need_weights=False)[0])
        return self.norm3(target + self.feed_forward(target))


class Stack(nn.Module):
    def __init__(self, layer, c, n_layers, norm=False):
        super().__init__()
        self.layers = nn.ModuleList(layer(c) for _ in range(n_layers))
        if norm:
            self.norm = nn.LayerNorm(c["hidden_dim"])


class Joiner(nn.Module):
    """Wrapper that gives the backbone's tensors the names they have in the benchmark's checkpoints."""

    def __init__(self, body):
        super().__init__()
        self.body = body


class Act(nn.Module):
    def __init__(self, c):
        super().__init__()
        self.c = c
        d = c["hidden_dim"]
        self.transformer = nn.Module()
        self.transformer.encoder = Stack(EncoderLayer, c, c["enc_layers"])
        self.transformer.decoder = Stack(DecoderLayer, c, c["dec_layers"], norm=True)
        self.action_head = nn.Linear(d, c["action_dim"])
        self.query_embed = nn.Embedding(c["num_queries"], d)
        self.backbones = nn.ModuleList([nn.Sequential(Joiner(ResNet18(c["backbone_width"])))])
        self.input_proj = nn.Conv2d(c["backbone_width"] * 8, d, 1)
        self.input_proj_robot_state = nn.Linear(c["state_dim"], d)
        self.latent_out_proj = nn.Linear(LATENT_DIM, d)
        self.additional_pos_embed = nn.Embedding(2, d)
        if c["language"]:
            e = c["language"]["dim"]
            self.lang_proj = nn.Sequential(
                nn.Linear(e, e), nn.ReLU(), nn.LayerNorm(e), nn.Linear(e, e), nn.ReLU(), nn.LayerNorm(e), nn.Linear(e, d)
            )
        # Used only in training.
        self.encoder = Stack(EncoderLayer, c, c["enc_layers"])
        self.cls_embed = nn.Embedding(1, d)
        self.encoder_state_proj = nn.Linear(c["state_dim"], d)
        self.encoder_action_proj = nn.Linear(c["action_dim"], d)
        self.latent_proj = nn.Linear(d, 2 * LATENT_DIM)

    def positions(self, side):
        """Return the positional encoding, `[side, side, hidden_dim]`: one half for the row, one for the column."""
        half = self.c["hidden_dim"] // 2
        coordinate = torch.arange(1, side + 1, dtype=torch.float32) / (side + 1e-6) * 2 * math.pi
        wavelength = 10000 ** (2 * (torch.arange(half) // 2) / half)
        phase = coordinate[:, None] / wavelength
        code = torch.stack([phase[:, 0::2].sin(), phase[:, 1::2].cos()], -1).flatten(1)
        return torch.cat([code[:, None].expand(-1, side, -1), code[None].expand(side, -1, -1)], -1)

    def forward(self, images, state, embedding=None):
        """Compute action chunks.

        Args:
            images: Normalised images, `[n, n_cameras, 3, 224, 224] f32`.
            state: State vectors, `[n, state_dim] f32`.
            embedding: Language embeddings, `[n, language_dim] f32`, or None.

        Returns:
            Action chunks `[n, num_queries, action_dim]` and backbone features `[n, n_cameras, C, 7, 7]`.
        """
        n, n_cameras = images.shape[:2]
        features = self.backbones[0][0].body(images.flatten(0, 1)).unflatten(0, (n, n_cameras))
        # Token order: the cameras' feature maps side by side, read row by row.
        image_tokens = self.input_proj(features.flatten(0, 1)).unflatten(0, (n, n_cameras))
        image_tokens = image_tokens.permute(0, 3, 1, 4, 2).flatten(1, 3)
        position = self.positions(features.shape[-1])
        image_position = position[:, None].expand(-1, n_cameras, -1, -1).flatten(0, 2)
        tokens = [self.latent_out_proj(torch.zeros(n, LATENT_DIM)), self.input_proj_robot_state(state)]
        positions = [self.additional_pos_embed.weight]
        if embedding is not None:
            tokens.append(self.lang_proj(embedding))
            positions.append(torch.zeros(1, self.c["hidden_dim"]))
        memory = torch.cat([torch.stack(tokens, 1), image_tokens], 1)
        positions = torch.cat([*positions, image_position])[None]
        for layer in self.transformer.encoder.layers:
            memory = layer(memory, positions)
        query_position = self.query_embed.weight.expand(n, -1, -1)
        decoder = self.transformer.decoder
        # The benchmark reads the first of the stacked intermediate outputs, so later layers have no effect.
        target = decoder.layers[0](torch.zeros_like(query_position), memory, positions, query_position)
        return self.action_head(decoder.norm(target)), features


# --- Checkpoint and reference outputs ---------------------------------------------------------------

def initialise(net, by_rule, random):
    """Initialise all weights by `generated_tensor`, or only the batch statistics, randomly."""
    with torch.no_grad():
        for name, tensor in net.state_dict().items():
            if by_rule:
                tensor.copy_(torch.from_numpy(np.asarray(generated_tensor(name, tuple(tensor.shape)))))
            elif name.endswith(("running_mean", "running_var")):
                # The default statistics would hide an error in folding them into the convolutions.
                values = torch.rand(tensor.shape, generator=random)
                tensor.copy_(values + 0.5 if name.endswith("var") else 0.2 * values - 0.1)


def generated_observation(env, morphology):
    """Return external images, hand images and state of an observation that policy-host's tests generate equally."""
    robot, n_hands = ROBOTS[morphology], ROBOTS[morphology]["n_cameras"] - 2
    pixels = lambda name, shape: (256 * unit(f"in.{env}.{name}", shape)).astype(np.uint8)
    external = pixels("external", (2, EXTERNAL_SIDE, EXTERNAL_SIDE, 3))
    # With blocks of 8x8 pixels, the resized image is smooth enough to compare but still has edges.
    hand = np.kron(pixels("hand", (n_hands, HAND_SIDE // 8, HAND_SIDE // 8, 3)), np.ones((1, 8, 8, 1), np.uint8))
    return external, hand, sym(f"in.{env}.state", (robot["state_dim"],), 1)


def normalised_images(external, hand):
    """Return network inputs, `[n_cameras, 3, 224, 224] f32`; hand images are resized as in `hypogeum.images`."""
    to_chw = lambda x: torch.from_numpy(x).permute(0, 3, 1, 2).float()
    resized = F.interpolate(
        to_chw(hand), (EXTERNAL_SIDE, EXTERNAL_SIDE), mode="bilinear", antialias=True, align_corners=False
    )
    # Halves round up, and so do values that floating-point error leaves just below a half.
    images = torch.cat([to_chw(external), (resized + 0.501).floor().clamp(0, 255)]) / 255
    mean, std = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    return (images - mean[:, None, None]) / std[:, None, None]


def reference(net, config, statistics):
    """Return PyTorch's actions and backbone features for one generated observation per instruction."""
    out = {"actions": [], "trunk": []}
    for env, instruction in enumerate(INSTRUCTIONS):
        external, hand, state = generated_observation(env, config["morphology"])
        embedding = None
        if instruction and config["language"]:
            embedding = torch.from_numpy(hashed_embedding(instruction, config["language"]["dim"]))
        state = torch.from_numpy(state)
        if statistics:
            state = (state - statistics["norm_stats.state_mean"]) / statistics["norm_stats.state_std"]
        with torch.no_grad():
            embedding = None if embedding is None else embedding[None]
            actions, features = net(normalised_images(external, hand)[None], state[None], embedding)
            actions, features = actions[0], features[0]
        if statistics:
            actions = actions * statistics["norm_stats.action_std"] + statistics["norm_stats.action_mean"]
        out["actions"].append(actions)
        # The features at the image centre, per camera: enough to locate the cause of a difference.
        out["trunk"].append(features[:, :, 3, 3])
    return {name: torch.stack(values).contiguous() for name, values in out.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="output folder")
    parser.add_argument("--morphology", choices=ROBOTS, default="single")
    parser.add_argument("--tiny", action="store_true", help="reduce widths to between a sixteenth and an eighth")
    parser.add_argument("--rule", action="store_true", help="compute the weights from tensor names")
    parser.add_argument("--statistics", action="store_true", help="add normalisation statistics")
    parser.add_argument("--lean", action="store_true", help="omit tensors that inference does not use")
    parser.add_argument("--reference", type=Path, metavar="FILE", help="also write PyTorch's outputs")
    parser.add_argument("--no-weights", action="store_true", help="write no checkpoint")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()

    config = dict(type="act_colosseum", morphology=args.morphology, **ROBOTS[args.morphology])
    config |= TINY if args.tiny else FULL
    torch.manual_seed(args.seed)
    net = Act(config).eval()
    initialise(net, args.rule, torch.Generator().manual_seed(args.seed))

    statistics = {}
    if args.statistics:
        for kind in ("state", "action"):
            shape = (config[f"{kind}_dim"],)
            for part, centre, bound in (("mean", 0, 0.3), ("std", 0.5, 0.3)):
                name = f"norm_stats.{kind}_{part}"
                statistics[name] = torch.from_numpy(centre + sym(name, shape, bound))

    tensors = {name: tensor.contiguous() for name, tensor in net.state_dict().items()} | statistics
    if args.lean:
        unused = r"encoder\.|cls_embed|encoder_|latent_proj|latent_out_proj\.weight|transformer\.decoder\.layers\.[1-9]"
        tensors = {name: tensor for name, tensor in tensors.items() if not re.match(unused, name)}
    if not args.no_weights:
        args.out.mkdir(parents=True, exist_ok=True)
        (args.out / "config.json").write_text(json.dumps(config, indent=2) + "\n")
        save_file(tensors, args.out / "model.safetensors")
    if args.reference:
        args.reference.parent.mkdir(parents=True, exist_ok=True)
        save_file(reference(net, config, statistics), args.reference)


if __name__ == "__main__":
    main()
