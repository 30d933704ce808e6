#!/usr/bin/env python3
"""Makes a folder that `act:PATH` can load out of a checkpoint of the benchmark's own ACT (`.pt`).

    convert_act_checkpoint.py best.pt OUT      OUT/config.json and OUT/model.safetensors, of the averaged weights;
                                               OUT/clip/model.safetensors, the text tower of the CLIP inside
    ... --weights raw                          the weights before averaging
    ... --control-mode pd_ee_pose              where widths and statistics do not tell it

Sizes are read off the tensors. Only data is unpickled, no code runs.
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
    """A checkpoint that cannot be converted; the message says what was found and what was expected."""


def read_checkpoint(path):
    """The dict that training saved, of tensors, arrays and plain values."""
    # Numpy 1 and 2 call the modules that make arrays and scalars differently.
    makers = [
        (example.__reduce__()[0], f"{module}.multiarray.{name}")
        for example, name in ((np.zeros(1), "_reconstruct"), (np.float32(0), "scalar"))
        for module in ("numpy.core", "numpy._core")
    ]
    types = [type(np.dtype(name)) for name in ("float32", "float64", "int64", "int32", "bool")]
    try:
        with torch.serialization.safe_globals([*makers, np.ndarray, np.dtype, *types]):
            saved = torch.load(path, map_location="cpu", weights_only=True)
    except OSError:
        raise
    except Exception as error:  # torch has no error of its own for this
        reason = str(error).partition("WeightsUnpickler error:")[2].strip() or str(error)
        reason = reason.partition("\n")[0].partition(" Please use")[0]
        raise ConversionError(f"it holds more than data, or is no checkpoint: {reason}") from error
    if not isinstance(saved, dict):
        raise ConversionError(f"it holds a {type(saved).__name__}, expected a dict with `agent` and `ema_agent`")
    return saved


def some(names):
    """The first few names, for a message."""
    names = sorted(map(str, names))
    return ", ".join(names[:8]) + (f", ... ({len(names)} in all)" if len(names) > 8 else "") if names else "nothing"


def split(state):
    """The network's tensors, as f32 and by the names without `model.`, and the language encoder's, as they are."""
    if not isinstance(state, dict) or not any(str(name).startswith(MODEL_PREFIX) for name in state):
        found = some(state) if isinstance(state, dict) else type(state).__name__
        raise ConversionError(f"the weights hold {found}; expected tensors named `{MODEL_PREFIX}...`")
    strange = [name for name in state if not name.startswith(MODEL_PREFIX)]
    if strange:
        raise ConversionError(f"the weights hold {some(strange)} outside `{MODEL_PREFIX}`")
    network, encoder = {}, {}
    for name, tensor in state.items():
        name = name.removeprefix(MODEL_PREFIX)
        if name.startswith(CLIP_PREFIX):
            encoder[name.removeprefix(CLIP_PREFIX)] = tensor
        elif tensor.is_floating_point():
            network[name] = tensor.float().contiguous()
    return network, encoder


def text_tower(encoder):
    """CLIP's text tower by its own names, whatever it is wrapped in; empty if there is none."""
    for tokens in (clip.TOKENS, clip.OPENAI_TOKENS):
        for name in encoder:
            wrapper = name.removesuffix(tokens)
            if name.endswith(tokens) and (not wrapper or wrapper.endswith(".")):
                found = {name.removeprefix(wrapper): x for name, x in encoder.items() if name.startswith(wrapper)}
                return {name: found[name].contiguous() for name in tower_names(found)}
    if encoder:
        raise ConversionError(f"`{CLIP_PREFIX}` holds {some(encoder)}; expected CLIP with a token embedding")
    return {}


def tower_names(found):
    """The names of a tower that has been checked."""
    try:
        clip.to_canonical({name: tensor.float().numpy() for name, tensor in found.items() if tensor.dim() < 3})
    except ValueError as error:
        raise ConversionError(str(error)) from error
    return clip.stored_names(found)


def statistics_of(saved, state_dim, action_dim):
    """`norm_stats` as tensors; empty for a network without."""
    stats = saved.get("norm_stats")
    if stats is None:
        return {}
    if not isinstance(stats, dict) or not set(STATISTICS) <= set(stats):
        found = some(stats) if isinstance(stats, dict) else type(stats).__name__
        raise ConversionError(f"`norm_stats` holds {found}; expected {', '.join(STATISTICS)}, or None")
    tensors = {}
    for name in STATISTICS:
        numbers = torch.as_tensor(np.asarray(stats[name], np.float32)).flatten().contiguous()
        expected = state_dim if name.startswith("state") else action_dim
        if len(numbers) != expected:
            raise ConversionError(f"`norm_stats.{name}` has {len(numbers)} numbers, expected {expected}")
        tensors[f"norm_stats.{name}"] = numbers
    return tensors


def robot_of(sizes, has_statistics, morphology, control_mode):
    """Morphology and control mode: those given, else those that fit the widths."""
    state_dim, action_dim = sizes["state_dim"], sizes["action_dim"]
    if morphology is None:
        morphology = next((name for name, robot in MORPHOLOGIES.items() if robot.state_dim == state_dim), None)
        if morphology is None:
            known = ", ".join(f"{robot.state_dim} ({name})" for name, robot in MORPHOLOGIES.items())
            raise ConversionError(f"the state has {state_dim} numbers, expected {known}; give --morphology")
    if control_mode is None:
        fitting = [mode for mode, dim in MORPHOLOGIES[morphology].action_dim.items() if dim == action_dim]
        # The benchmark normalises where the control mode is not of differences.
        control_mode = next((mode for mode in fitting if ("delta" in mode) != has_statistics), None)
        if control_mode is None:
            state = "with" if has_statistics else "without"
            raise ConversionError(
                f"no control mode of the {morphology} robot has actions of {action_dim} numbers {state} statistics; "
                "give --control-mode"
            )
    return morphology, control_mode


def sizes_of(network):
    """The sizes of a network, as config.json spells them."""

    def shape(name):
        if name not in network:
            raise ConversionError(f"tensor `{MODEL_PREFIX}{name}` is missing; found {some(network)}")
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
    """The language section: of which encoder the network's token is made, if it has one."""
    if "lang_proj.0.weight" not in network:
        return None
    if not tower:
        raise ConversionError(f"the network sees instructions, but there is no `{MODEL_PREFIX}{CLIP_PREFIX}`")
    canonical = clip.to_canonical({name: tensor.float().numpy() for name, tensor in tower.items()})
    found, expected = canonical[clip.PROJECTION].shape[0], network["lang_proj.0.weight"].shape[1]
    if found != expected:
        raise ConversionError(f"CLIP's embeddings have {found} numbers, `lang_proj` takes {expected}")
    return dict(encoder="clip-vit-b-32", weights="clip", fingerprint=clip.fingerprint(canonical))


def convert(path, out, weights="ema", nheads=8, morphology=None, control_mode=None):
    """Writes the folder `out` and returns its configuration."""
    saved = read_checkpoint(path)
    if WEIGHTS[weights] not in saved:
        raise ConversionError(f"it holds {some(saved)}; expected `{WEIGHTS[weights]}`")
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
    parser.add_argument("checkpoint", type=Path, help="what training saved")
    parser.add_argument("out", type=Path, help="folder to write")
    parser.add_argument("--weights", choices=WEIGHTS, default="ema", help="the benchmark evaluates the averaged ones")
    parser.add_argument("--nheads", type=int, default=8, help="attention heads, which no tensor shows")
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
