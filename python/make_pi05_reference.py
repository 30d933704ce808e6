#!/usr/bin/env python3
"""Write tiny LeRobot π0.5 checkpoints and LeRobot's outputs for them, for policy-host's tests.

    make_pi05_reference.py OUT

Creates one folder per case in OUT, each with LeRobot's own files, `tokenizer.model`, `io.json` (instructions) and
`io.safetensors`: inputs, and the results of every stage.

| case | contents |
|--|--|
| `robot` | the benchmark's single arm: three cameras, 16 state entries, 7-wide action, two lengths of prompt |
| `one_camera` | one camera of another size, 9 state entries, 8-wide action |
| `missing` | three cameras, of which only two have a counterpart |
| `padded` | `one_camera` with the prompt of LeRobot before 0.5, whose state is padded to 32 numbers; no weights |
| `bf16` | `robot` with the weights rounded to bfloat16, in two shards; results in f32 and in LeRobot's bfloat16 |
| `openpi` | what openpi stores instead of LeRobot's configuration: statistics; and our `hypogeum.json` for it |

The networks have few and narrow layers and see images of 56 × 56 pixels, so that a checkpoint stays below 400 KB.
Weights and inputs are derived from a seed. The case `robot` contains the actions for the observations that
`make_act_checkpoint.py` and policy-host's tests generate. Needs `lerobot[pi]==0.6.1` and Python 3.12.
"""

import argparse
import io
import json
from pathlib import Path

import numpy as np
import sentencepiece
import torch
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.policies.pi05.configuration_pi05 import PI05Config
from lerobot.policies.pi05.modeling_pi05 import PI05Policy
from make_act_checkpoint import INSTRUCTIONS, generated_observation
from safetensors.torch import load_file, save_file

from hypogeum.pi05 import Widths, narrow, pad_prompt, processors_of
from hypogeum.tokenizer import Tokenizer

STATE, ACTION = "observation.state", "action"
SIDE, PATCHES, VOCABULARY, MAX_TOKENS = 56, 16, 384, 160
WIDTHS = Widths(
    vision=dict(hidden_size=24, num_hidden_layers=2, num_attention_heads=3, intermediate_size=40),
    prefix=dict(width=32, depth=2, mlp_dim=64, num_heads=8, head_dim=8),
    expert=dict(width=16, depth=2, mlp_dim=32, num_heads=8, head_dim=8),
    vocabulary=VOCABULARY,
)
TEXTS = [
    "Raise the red cube above the table.",
    "put the dish into the rack, then open the drawer 0 1 2 3 4 5 6 7 8 9",
    "Task: lift the pot with both arms, State: 12 255 -1;\nAction: ",
    "stack the green cube on top of the blue cube",
]


def train_tokenizer():
    """Return a SentencePiece model with the conventions of PaliGemma's: byte-pair encoding of separate digits."""
    model = io.BytesIO()
    sentencepiece.SentencePieceTrainer.train(
        sentence_iterator=iter(TEXTS * 4), model_writer=model, model_type="bpe", vocab_size=VOCABULARY,
        byte_fallback=True, add_dummy_prefix=False, remove_extra_whitespaces=False, split_digits=True,
        normalization_rule_name="identity", character_coverage=1.0, user_defined_symbols=["\n"], num_threads=1,
        pad_id=0, eos_id=1, bos_id=2, unk_id=3, bos_piece="<bos>", eos_piece="<eos>", minloglevel=2,
        hard_vocab_limit=False,
    )  # fmt: skip
    return model.getvalue()


def feature(kind, *shape):
    return PolicyFeature(type=kind, shape=shape)


def config(cameras, state_dim, action_dim, **others):
    images = {f"observation.images.{name}": feature(FeatureType.VISUAL, 3, side, side) for name, side in cameras}
    return PI05Config(
        input_features={**images, STATE: feature(FeatureType.STATE, state_dim)},
        output_features={ACTION: feature(FeatureType.ACTION, action_dim)},
        chunk_size=10, n_action_steps=10, image_resolution=(SIDE, SIDE), tokenizer_max_length=MAX_TOKENS, device="cpu",
        **others,
    )  # fmt: skip


def randomise(policy, random):
    """Replace zero weights, scales and biases, which would hide errors in their use."""
    with torch.no_grad():
        for name, tensor in policy.named_parameters():
            uniform = 2 * torch.rand(tensor.shape, generator=random) - 1
            if tensor.dim() == 1:
                is_scale = "vision_tower" in name and name.endswith("weight")
                tensor.copy_(is_scale + 0.1 * uniform)
            elif "embed" in name and tensor.dim() == 2:
                tensor.copy_(uniform)
            else:
                tensor.copy_(uniform * (3 / tensor[0].numel()) ** 0.5)


def statistics(features, random):
    stats = {}
    for name, feature in features.items():
        if feature.type is not FeatureType.VISUAL:
            low = -1.2 + 0.4 * torch.rand(feature.shape, generator=random)
            stats[name] = dict(q01=low, q99=low + 1.5 + torch.rand(feature.shape, generator=random))
    return stats


def sample_inputs(config, n, random):
    """Draw `n` inputs: images `[n, 3, height, width] u8`, states `[n, dim] f32`."""
    inputs = {}
    for name, feature in config.input_features.items():
        if feature.type is FeatureType.VISUAL:
            inputs[name] = torch.randint(0, 256, (n, *feature.shape), generator=random, dtype=torch.uint8)
        else:
            inputs[name] = 2 * torch.rand((n, *feature.shape), generator=random) - 1
    return inputs


def robot_inputs():
    """Return the generated observations of three envs."""
    envs = [generated_observation(env, "single") for env in range(3)]
    image = lambda pixels: torch.from_numpy(np.stack(pixels)).permute(0, 3, 1, 2)
    states = torch.from_numpy(np.stack([state for _, _, state in envs]))
    return {
        "observation.images.external1": image([external[0] for external, _, _ in envs]),
        "observation.images.external2": image([external[1] for external, _, _ in envs]),
        "observation.images.hand": image([hand[0] for _, hand, _ in envs]),
        STATE: torch.cat([states[:, :9], states[:, 18:25]], dim=1),
    }


@torch.no_grad()
def outputs(policy, processors, inputs, texts, noise):
    """Return LeRobot's results of every stage."""
    preprocess, postprocess = processors
    batch = {name: x.float() / 255 if x.dtype == torch.uint8 else x for name, x in inputs.items()}
    batch = preprocess(batch | {"task": list(texts)})
    tokens, mask = batch["observation.language.tokens"], batch["observation.language.attention_mask"].bool()
    network, config = policy.model, policy.config
    images, masks = policy._preprocess_images(batch)
    prefix, prefix_mask, _ = network.embed_prefix(images, masks, tokens, mask)
    velocities = []
    denoise = network.denoise_step

    def recorded(*args, **kwargs):
        velocities.append(denoise(*args, **kwargs))
        return velocities[-1]

    network.denoise_step = recorded
    actions = network.sample_actions(images, masks, tokens, mask, noise=noise)
    network.denoise_step = denoise
    dim = config.output_features[ACTION].shape[0]
    n_images = sum(bool(mask.all()) for mask in masks)
    rows = [postprocess(actions[:, row, :dim]) for row in range(actions.shape[1])]
    return dict(
        tokens=tokens.int(),
        token_mask=mask,
        pixels=torch.stack([image[0].float() for image in images[:n_images]]),
        image_embeddings=torch.stack(
            [network.paligemma_with_expert.embed_image(x[:1])[0].float() for x in images[:n_images]]
        ),
        prefix=prefix[0][prefix_mask[0]].float(),
        noise=noise,
        velocity_0=velocities[0],
        velocity_9=velocities[9],
        actions32=actions,
        actions=torch.stack(rows, dim=1).float(),
    )


def save(folder, policy, processors, tokenizer, sidecar):
    policy.save_pretrained(folder)
    for processor in processors:
        processor.save_pretrained(folder)
    (folder / "README.md").unlink(missing_ok=True)
    (folder / "tokenizer.model").write_bytes(tokenizer)
    (folder / "hypogeum.json").write_text(json.dumps({"vision_heads": 3, **sidecar}, indent=2) + "\n")


def save_io(folder, inputs, results, texts):
    tensors = {f"in.{name}": x for name, x in inputs.items()} | results
    save_file({name: x.contiguous() for name, x in tensors.items()}, folder / "io.safetensors")
    (folder / "io.json").write_text(json.dumps({"instructions": list(texts)}, indent=2) + "\n")


def write(folder, config, seed, sidecar, generated=None, texts=TEXTS[:2], left_out=(), padded=False):
    """Write one case and return its policy, processors, inputs, noise and tokenizer. Generated inputs are left out."""
    random = torch.Generator().manual_seed(seed)
    tokenizer = train_tokenizer()
    with narrow(WIDTHS):
        policy = PI05Policy(config).eval()
    randomise(policy, random)
    stats = statistics(config.input_features | config.output_features, random)
    processors = processors_of(config, stats, Tokenizer.from_sentencepiece(tokenizer))
    if padded:
        pad_prompt(processors[0], config.max_state_dim)
    inputs = generated or sample_inputs(config, len(texts), random)
    inputs = {name: x for name, x in inputs.items() if name not in left_out}
    noise = torch.randn((len(texts), config.chunk_size, config.max_action_dim), generator=random)
    results = outputs(policy, processors, inputs, texts, noise)
    save(folder, policy, processors, tokenizer, sidecar)
    save_io(folder, {} if generated else inputs, results, texts)
    return policy, processors, inputs, noise, tokenizer


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("out", type=Path, help="output folder")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)

    cameras = [("external1", 224), ("external2", 224), ("hand", 128)]
    sidecar = {"mapping": {STATE: ["qpos", "tcp_pose"]}}
    texts = [INSTRUCTIONS[env % 2] for env in range(3)]
    policy, processors, inputs, noise, tokenizer = write(
        out / "robot", config(cameras, 16, 7), 1, sidecar, robot_inputs(), texts
    )

    folder = out / "bf16"
    with torch.no_grad():
        for parameter in policy.parameters():
            parameter.copy_(parameter.bfloat16().float())
    results = outputs(policy, processors, inputs, texts, noise)
    save(folder, policy, processors, tokenizer, sidecar)
    tensors = {name: x.bfloat16() for name, x in load_file(folder / "model.safetensors").items()}
    (folder / "model.safetensors").unlink()
    names, index = sorted(tensors), {}
    for shard, part in enumerate((names[: len(names) // 2], names[len(names) // 2 :])):
        file = f"model-{shard + 1:05}-of-00002.safetensors"
        save_file({name: tensors[name] for name in part}, folder / file)
        index |= dict.fromkeys(part, file)
    index = json.dumps({"metadata": {}, "weight_map": index}, indent=2)
    (folder / "model.safetensors.index.json").write_text(index + "\n")
    policy.model.paligemma_with_expert.to_bfloat16_for_selected_params("bfloat16")
    rough = outputs(policy, processors, inputs, texts, noise)
    results["bf16.actions32"] = rough["actions32"].float()
    save_io(folder, {}, results, texts)

    write(out / "one_camera", config([("hand", 84)], 9, 8), 2, {"control_mode": "pd_joint_pos"})
    write(
        out / "padded", config([("hand", 84)], 9, 8), 2, {"control_mode": "pd_joint_pos", "prompt_state": "padded"},
        padded=True,
    )  # fmt: skip
    three = config([("base_0_rgb", 56), ("left_wrist_0_rgb", 84), ("right_wrist_0_rgb", 56)], 9, 8)
    names = [f"observation.images.{name}_rgb" for name in ("base_0", "left_wrist_0", "right_wrist_0")]
    mapping = dict(zip(names, ("external1", "hand", "none"), strict=True))
    write(out / "missing", three, 3, {"control_mode": "pd_joint_pos", "mapping": mapping}, left_out=names[2:])

    # Both share the weights of `one_camera`.
    for path in (out / "padded").glob("*"):
        if path.name not in ("io.json", "io.safetensors", "hypogeum.json"):
            path.unlink()
    folder = out / "openpi"
    stats = load_file(next((out / "one_camera").glob("policy_preprocessor_step_*.safetensors")))
    of = lambda name: {key: stats[f"{name}.{key}"].tolist() for key in ("q01", "q99")}
    (folder / "assets" / "demos").mkdir(parents=True, exist_ok=True)
    norm_stats = {"norm_stats": {"state": of(STATE), "actions": of(ACTION)}}
    (folder / "assets" / "demos" / "norm_stats.json").write_text(json.dumps(norm_stats, indent=2) + "\n")
    sidecar = {
        "vision_heads": 3, "chunk_size": 10, "morphology": "single", "control_mode": "pd_joint_pos",
        "mapping": {"base_0_rgb": "none", "left_wrist_0_rgb": "hand", "right_wrist_0_rgb": "none", STATE: "qpos"},
    }  # fmt: skip
    (folder / "hypogeum.json").write_text(json.dumps(sidecar, indent=2) + "\n")


if __name__ == "__main__":
    main()
