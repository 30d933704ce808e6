#!/usr/bin/env python3
"""Convert a checkpoint of the benchmark's own ACT (`.pt`) to a folder that `act:PATH` can load.

    convert_act_checkpoint.py best.pt OUT      write OUT/config.json, OUT/model.safetensors (averaged weights) and
                                               OUT/clip/model.safetensors (text tower of the CLIP inside)
    ... --weights raw                          use the weights before averaging
    ... --control-mode pd_ee_pose              override the control mode inferred from widths and statistics

Sizes are inferred from the tensors. Unpickling is restricted to data; no code from the checkpoint runs.
Needs `torch`, `numpy`, `safetensors` and `xxhash`.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file

from hypogeum import clip
from hypogeum.layout import CONTROL_MODES, MORPHOLOGIES
from hypogeum.robot import CAMERAS

MODEL_PREFIX, CLIP_PREFIX = "model.", "lang_encoder."
STATISTICS = ("state_mean", "state_std", "action_mean", "action_std")
WEIGHTS = {"ema": "ema_agent", "raw": "agent"}


class ConversionError(Exception):
    """A checkpoint that cannot be converted."""


def read_checkpoint(path):
    """Load the dict of tensors, arrays and plain values that training saved."""
    # The modules of the functions that construct arrays and scalars have different names in numpy 1 and 2.
    constructors = [
        (example.__reduce__()[0], f"{module}.multiarray.{name}")
        for example, name in ((np.zeros(1), "_reconstruct"), (np.float32(0), "scalar"))
        for module in ("numpy.core", "numpy._core")
    ]
    types = [type(np.dtype(name)) for name in ("float32", "float64", "int64", "int32", "bool")]
    try:
        with torch.serialization.safe_globals([*constructors, np.ndarray, np.dtype, *types]):
            saved = torch.load(path, map_location="cpu", weights_only=True)
    except OSError:
        raise
    except Exception as error:  # torch raises no specific exception type here
        reason = str(error).partition("WeightsUnpickler error:")[2].strip() or str(error)
        reason = reason.partition("\n")[0].partition(" Please use")[0]
        raise ConversionError(f"it contains more than data, or is not a checkpoint: {reason}") from error
    if not isinstance(saved, dict):
        raise ConversionError(f"it contains a {type(saved).__name__}, expected a dict with `agent` and `ema_agent`")
    return saved


def summarize(names):
    """Return the first few names as text for an error message."""
    names = sorted(map(str, names))
    return ", ".join(names[:8]) + (f", ... ({len(names)} in all)" if len(names) > 8 else "") if names else "nothing"


def split(state):
    """Split the weights into two dicts, both keyed without the prefix `model.`.

    Returns:
        The network's tensors, converted to f32, and the language encoder's tensors, unchanged.
    """
    if not isinstance(state, dict) or not any(str(name).startswith(MODEL_PREFIX) for name in state):
        found = summarize(state) if isinstance(state, dict) else type(state).__name__
        raise ConversionError(f"the weights contain {found}; expected tensors named `{MODEL_PREFIX}...`")
    unexpected = [name for name in state if not name.startswith(MODEL_PREFIX)]
    if unexpected:
        raise ConversionError(f"the weights contain {summarize(unexpected)} outside `{MODEL_PREFIX}`")
    network, encoder = {}, {}
    for name, tensor in state.items():
        name = name.removeprefix(MODEL_PREFIX)
        if name.startswith(CLIP_PREFIX):
            encoder[name.removeprefix(CLIP_PREFIX)] = tensor
        elif tensor.is_floating_point():
            network[name] = tensor.float().contiguous()
    return network, encoder


def text_tower(encoder):
    """Return CLIP's text tower without the prefix of its wrapper module, or an empty dict if there is none."""
    for tokens in (clip.TOKENS, clip.OPENAI_TOKENS):
        for name in encoder:
            wrapper = name.removesuffix(tokens)
            if name.endswith(tokens) and (not wrapper or wrapper.endswith(".")):
                found = {name.removeprefix(wrapper): x for name, x in encoder.items() if name.startswith(wrapper)}
                return {name: found[name].contiguous() for name in tower_names(found)}
    if encoder:
        raise ConversionError(f"`{CLIP_PREFIX}` contains {summarize(encoder)}; expected CLIP with a token embedding")
    return {}


def tower_names(found):
    """Validate a text tower and return the names of its tensors."""
    try:
        clip.to_canonical({name: tensor.float().numpy() for name, tensor in found.items() if tensor.dim() < 3})
    except ValueError as error:
        raise ConversionError(str(error)) from error
    return clip.stored_names(found)


def statistics_of(saved, state_dim, action_dim):
    """Return `norm_stats` as tensors, or an empty dict if the network does not normalise."""
    stats = saved.get("norm_stats")
    if stats is None:
        return {}
    if not isinstance(stats, dict) or not set(STATISTICS) <= set(stats):
        found = summarize(stats) if isinstance(stats, dict) else type(stats).__name__
        raise ConversionError(f"`norm_stats` contains {found}; expected {', '.join(STATISTICS)}, or None")
    tensors = {}
    for name in STATISTICS:
        values = torch.as_tensor(np.asarray(stats[name], np.float32)).flatten().contiguous()
        expected = state_dim if name.startswith("state") else action_dim
        if len(values) != expected:
            raise ConversionError(f"`norm_stats.{name}` has {len(values)} values, expected {expected}")
        tensors[f"norm_stats.{name}"] = values
    return tensors


def robot_of(sizes, has_statistics, morphology, control_mode):
    """Return the morphology and control mode: those given, otherwise those that match the widths."""
    state_dim, action_dim = sizes["state_dim"], sizes["action_dim"]
    if morphology is None:
        morphology = next((name for name, robot in MORPHOLOGIES.items() if robot.state_dim == state_dim), None)
        if morphology is None:
            known = ", ".join(f"{robot.state_dim} ({name})" for name, robot in MORPHOLOGIES.items())
            raise ConversionError(f"the state has width {state_dim}, expected {known}; pass --morphology")
    if control_mode is None:
        candidates = [mode for mode, dim in MORPHOLOGIES[morphology].action_dim.items() if dim == action_dim]
        # The benchmark normalises actions unless the control mode is relative.
        control_mode = next((mode for mode in candidates if ("delta" in mode) != has_statistics), None)
        if control_mode is None:
            state = "with" if has_statistics else "without"
            raise ConversionError(
                f"no control mode of the {morphology} robot has actions of width {action_dim} {state} statistics; "
                "pass --control-mode"
            )
    return morphology, control_mode


def sizes_of(network):
    """Return the sizes of a network under the keys of config.json."""

    def shape(name):
        if name not in network:
            raise ConversionError(f"tensor `{MODEL_PREFIX}{name}` is missing; found {summarize(network)}")
        return network[name].shape

    return dict(
        state_dim=shape("input_proj_robot_state.weight")[1],
        action_dim=shape("action_head.weight")[0],
        num_queries=shape("query_embed.weight")[0],
        hidden_dim=shape("action_head.weight")[1],
        dim_feedforward=shape("transformer.encoder.layers.0.linear1.weight")[0],
        enc_layers=clip.count_layers(network, "transformer.encoder.layers.{}."),
        dec_layers=clip.count_layers(network, "transformer.decoder.layers.{}."),
        backbone="resnet18",
        backbone_width=shape("backbones.0.0.body.conv1.weight")[0],
    )


def language_of(network, tower):
    """Return the language section of config.json, or None if the network has no language token."""
    if "lang_proj.0.weight" not in network:
        return None
    if not tower:
        raise ConversionError(f"the network takes instructions, but there is no `{MODEL_PREFIX}{CLIP_PREFIX}`")
    canonical = clip.to_canonical({name: tensor.float().numpy() for name, tensor in tower.items()})
    found, expected = canonical[clip.PROJECTION].shape[0], network["lang_proj.0.weight"].shape[1]
    if found != expected:
        raise ConversionError(f"CLIP's embeddings have width {found}, `lang_proj` expects {expected}")
    return dict(encoder="clip-vit-b-32", weights="clip", fingerprint=clip.fingerprint(canonical))


def convert(path, out, weights="ema", nheads=8, morphology=None, control_mode=None):
    """Write the folder `out` and return its configuration."""
    saved = read_checkpoint(path)
    if WEIGHTS[weights] not in saved:
        raise ConversionError(f"it contains {summarize(saved)}; expected `{WEIGHTS[weights]}`")
    network, encoder = split(saved[WEIGHTS[weights]])
    sizes, tower = sizes_of(network), text_tower(encoder)
    statistics = statistics_of(saved, sizes["state_dim"], sizes["action_dim"])
    morphology, control_mode = robot_of(sizes, bool(statistics), morphology, control_mode)
    config = dict(
        type="act_colosseum", morphology=morphology, control_mode=control_mode, **sizes, nheads=nheads,
        n_cameras=len(CAMERAS[morphology]), language=language_of(network, tower),
    )
    out.mkdir(parents=True, exist_ok=True)
    save_file(network | statistics, out / "model.safetensors")
    if config["language"]:
        (out / "clip").mkdir(exist_ok=True)
        save_file(tower, out / "clip/model.safetensors")
    (out / "config.json").write_text(json.dumps(config, indent=2) + "\n")
    return config


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path, help="checkpoint saved by the benchmark's training")
    parser.add_argument("out", type=Path, help="folder to write")
    parser.add_argument("--weights", choices=WEIGHTS, default="ema", help="the benchmark evaluates the averaged ones (ema)")
    parser.add_argument("--nheads", type=int, default=8, help="attention heads; not inferable from the tensors")
    parser.add_argument("--morphology", choices=MORPHOLOGIES)
    parser.add_argument("--control-mode", choices=CONTROL_MODES)
    args = parser.parse_args()
    try:
        config = convert(args.checkpoint, args.out, args.weights, args.nheads, args.morphology, args.control_mode)
    except (ConversionError, OSError) as error:
        sys.exit(f"failed to convert {args.checkpoint}: {error}")
    print(json.dumps(config, indent=2))


if __name__ == "__main__":
    main()
