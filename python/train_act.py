#!/usr/bin/env python3
"""Train LeRobot's ACT on demonstrations from `hypogeum demos` and evaluate every checkpoint in the simulator.

    hypogeum demos -o demos --tasks RaiseCube --episodes 100
    train_act.py demos/single -o raise-cube --evaluate target/release/hypogeum
    hypogeum run --policy act=act:raise-cube --tasks RaiseCube --episodes 200

Needs Python 3.12 and LeRobot 0.6 (`pip install './python[lerobot]' 'lerobot[dataset]'`). Uses a GPU if there is one.
After an interruption, the same command resumes from the last checkpoint. The output folder is a LeRobot checkpoint of
the averaged weights in half precision; its sub-folder `training` holds what only training needs: images, optimiser
state and log.
"""

import argparse
import copy
import functools
import json
import math
import os
import sys
import time
from pathlib import Path

from hypogeum.requirements import explained

INSTALL = "pip install './python[lerobot]' 'lerobot[dataset]'"
with explained(INSTALL):
    import numpy as np
    import torch
    import torch.nn.functional as F
    from safetensors.torch import load_file, save_file
    from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn
    from torchvision.ops.misc import FrozenBatchNorm2d

    from hypogeum.backbone import resnet18_of
    from hypogeum.images import to_network
    from hypogeum.training import success_rates
    from lerobot.configs.types import FeatureType, PolicyFeature
    from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.act.modeling_act import ACTPolicy
    from lerobot.policies.act.processor_act import make_act_pre_post_processors

STATE, INSTRUCTION, ACTION = "observation.state", "observation.environment_state", "action"
# Lower bound on the standard deviations by which vectors are divided, as in the benchmark's own training.
MIN_STD = 0.01
WARM_UP_STEPS = 500
# Fraction of all steps over which the learning rate decays to zero.
COOL_DOWN = 0.25
# Side in pixels of the images from which the batch statistics are computed.
CALIBRATION_SIDE = 64
# Arguments that must not change when training resumes.
FIXED = ("tasks", "batch_size", "width", "shrink", "dim", "layers", "chunk", "dropout", "vae", "ema", "seed", "init")


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path, help="dataset of one morphology, for example demos/single")
    parser.add_argument("-o", "--output", type=Path, required=True, help="checkpoint folder")
    parser.add_argument("--tasks", help="comma-separated task names (default: all in the dataset)")
    parser.add_argument("--steps", type=int, default=20_000, help="total updates; may be increased when resuming")
    parser.add_argument("--batch-size", type=int, default=16)
    parser.add_argument("--lr", type=float, default=2e-4)
    parser.add_argument("--width", type=int, default=64, help="channels of the ResNet-18's first stage; usually 64")
    parser.add_argument("--shrink", type=int, default=1, help="factor by which images are downscaled")
    parser.add_argument("--dim", type=int, default=512, help="width of the transformer")
    parser.add_argument("--layers", type=int, default=4, help="number of encoder layers")
    parser.add_argument("--dropout", type=float, default=0.1, help="dropout rate of the transformer")
    parser.add_argument("--chunk", type=int, default=30, help="rows of an action chunk")
    parser.add_argument("--vae", action="store_true", help="train with ACT's latent variable; scripted demos need none")
    parser.add_argument("--ema", type=float, default=0.999, help="decay of the averaged weights, per step")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--init", metavar="CHECKPOINT", help="fine-tune the weights of a checkpoint of this script")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--save-every", type=int, default=1000, help="steps between checkpoints")
    parser.add_argument("--evaluate", metavar="HYPOGEUM", help="binary with which to evaluate every checkpoint")
    parser.add_argument("--episodes", type=int, default=20, help="episodes per task in an evaluation")
    parser.add_argument("--evaluation-seed", type=int, default=7, help="use another seed for reported results")
    return parser.parse_args()


@functools.lru_cache(maxsize=1)
def shuffled(n, seed, epoch):
    """Return the order of the frames in an epoch, a permutation of `range(n)`."""
    return np.random.default_rng([seed, epoch]).permutation(n)


class Demonstrations:
    """Frames of the selected tasks: vectors in memory, images memory-mapped in the network's input size.

    Args:
        root: Folder of the dataset.
        tasks: Task names, or None for all.
        shrink: Factor by which images are downscaled.
        chunk: Rows of an action chunk.
        cache: Folder for the decoded images.
    """

    def __init__(self, root, tasks, shrink, chunk, cache):
        if not (root / "meta/hypogeum.jsonl").exists():
            sys.exit(f"{root} has no meta/hypogeum.jsonl: expected a dataset of `hypogeum demos`, such as demos/single")
        rows = [row for line in (root / "meta/hypogeum.jsonl").read_text().splitlines() for row in json.loads(line)]
        self.tasks = sorted(set(tasks or (row["task"] for row in rows)))
        unknown = set(self.tasks) - {row["task"] for row in rows}
        if unknown:
            sys.exit(f"{root} has no episodes of {', '.join(sorted(unknown))}")
        name = f"hypogeum/{root.name}"
        meta = LeRobotDatasetMetadata(name, root=root)
        episodes = [idx for idx, row in enumerate(rows) if row["task"] in self.tasks]
        sides = {key: meta.features[key]["shape"][:2] for key in meta.camera_keys}
        self.cameras = {key: [3, *(side // shrink for side in shape)] for key, shape in sides.items()}
        lengths = np.array([rows[idx]["n_frames"] for idx in episodes])
        self.n_frames = int(lengths.sum())
        # End of its episode (exclusive), per frame.
        self.ends = np.repeat(np.cumsum(lengths), lengths)
        self.offsets = np.arange(chunk)
        paths = {key: cache / f"{key}-{'-'.join(map(str, shape[1:]))}.npy" for key, shape in self.cameras.items()}
        vectors = cache / "vectors.safetensors"
        if not all(path.exists() for path in [*paths.values(), vectors]):
            self.fill(LeRobotDataset(name, root=root, episodes=episodes), paths, vectors)
        self.images = {key: np.load(path, mmap_mode="r") for key, path in paths.items()}
        self.vectors = load_file(vectors)
        found = {len(values) for values in [*self.images.values(), *self.vectors.values()]}
        if found != {self.n_frames}:
            sys.exit(f"{cache} was made from another dataset or other tasks; remove it")

    def fill(self, dataset, paths, vectors):
        """Decode every image once. The vectors are written last and mark the cache as complete."""
        vectors.unlink(missing_ok=True)
        images = {
            key: np.lib.format.open_memmap(path, "w+", np.uint8, (self.n_frames, *self.cameras[key][1:], 3))
            for key, path in paths.items()
        }
        frames, values = dataset.hf_dataset.with_format(None), {STATE: [], INSTRUCTION: [], ACTION: []}
        start = time.monotonic()
        for idx, frame in enumerate(frames):
            for key, array in images.items():
                pixels = to_network(np.asarray(frame[key])[None], *self.cameras[key][1:])
                array[idx] = (pixels[0] * 255).round().permute(1, 2, 0).numpy()
            for key, rows in values.items():
                rows.append(frame[key])
            if idx % 5000 == 0:
                print(f"decoded {idx} of {self.n_frames} frames, {time.monotonic() - start:.0f} s", flush=True)
        for array in images.values():
            array.flush()
        save_file({key: torch.tensor(np.array(rows, np.float32)) for key, rows in values.items()}, vectors)

    def stats(self):
        """Return means and standard deviations, of vectors per element and of images per channel."""
        stats = {}
        for key, values in self.vectors.items():
            stats[key] = {"mean": values.mean(0), "std": values.std(0).clamp_min(MIN_STD)}
        for key, images in self.images.items():
            sample = np.asarray(images[:: max(1, self.n_frames // 2000)], np.float64) / 255
            moments = {"mean": sample.mean((0, 1, 2)), "std": sample.std((0, 1, 2))}
            stats[key] = {name: torch.tensor(value).float()[:, None, None] for name, value in moments.items()}
        return stats

    def batch(self, step, size, seed):
        """Return the batch of a training step, a function of the arguments alone. An epoch visits every frame once."""
        per_epoch = self.n_frames // size
        frames = np.sort(shuffled(self.n_frames, seed, step // per_epoch)[step % per_epoch * size :][:size])
        future = frames[:, None] + self.offsets
        last = self.ends[frames][:, None] - 1
        batch = {key: torch.from_numpy(images[frames]).permute(0, 3, 1, 2) / 255 for key, images in self.images.items()}
        batch |= {key: self.vectors[key][frames] for key in (STATE, INSTRUCTION)}
        batch[ACTION] = self.vectors[ACTION][np.minimum(future, last)]
        batch["action_is_pad"] = torch.from_numpy(future > last)
        return batch


def make_policy(args, data):
    """Return a randomly initialised `ACTPolicy` for the dataset."""
    vectors = {key: FeatureType.ENV if key == INSTRUCTION else FeatureType.STATE for key in (STATE, INSTRUCTION)}
    features = {key: PolicyFeature(kind, (data.vectors[key].shape[1],)) for key, kind in vectors.items()}
    features |= {key: PolicyFeature(FeatureType.VISUAL, tuple(shape)) for key, shape in data.cameras.items()}
    config = ACTConfig(
        input_features=features,
        output_features={ACTION: PolicyFeature(FeatureType.ACTION, (data.vectors[ACTION].shape[1],))},
        device=args.device, push_to_hub=False, pretrained_backbone_weights=None,
        chunk_size=args.chunk, n_action_steps=args.chunk, use_vae=args.vae,
        dim_model=args.dim, dim_feedforward=2 * args.dim, n_encoder_layers=args.layers, dropout=args.dropout,
    )
    with resnet18_of(args.width):
        return ACTPolicy(config).to(args.device)


def load_weights(policy, folder):
    """Load the weights of an exported checkpoint; its network must have the same shape."""
    path = Path(folder) / "model.safetensors"
    if not path.is_file():
        sys.exit(f"{path} does not exist: expected a checkpoint folder of this script")
    weights = load_file(path)
    expected = {name: tuple(value.shape) for name, value in policy.state_dict().items()}
    found = {name: tuple(value.shape) for name, value in weights.items()}
    for name in sorted(expected.keys() | found.keys()):
        if expected.get(name) != found.get(name):
            sys.exit(f"{path}: {name} has shape {found.get(name)}, expected {expected.get(name)}")
    policy.load_state_dict(weights)


@torch.no_grad()
def calibrate(policy, batch):
    """Set the frozen batch normalisations, layer by layer, to a batch's statistics; training never updates them."""

    def measure(norm, inputs):
        norm.running_mean.copy_(inputs[0].mean((0, 2, 3)))
        norm.running_var.copy_(inputs[0].var((0, 2, 3)))

    norms = [module for module in policy.modules() if isinstance(module, FrozenBatchNorm2d)]
    hooks = [norm.register_forward_pre_hook(measure) for norm in norms]
    # The cameras share the backbone, so their images form one batch, resized to a small common size.
    images = [F.interpolate(batch[key], CALIBRATION_SIDE) for key in policy.config.image_features]
    policy.model.backbone(torch.cat(images))
    for hook in hooks:
        hook.remove()


def learning_rate(step, args):
    """Return the learning rate of a step: warm-up, constant, then linear decay to zero.

    Because the rate is constant in between, a run can be extended with a larger `--steps`.
    """
    return args.lr * min((step + 1) / WARM_UP_STEPS, (args.steps - step) / (COOL_DOWN * args.steps), 1)


def export(policy, processors, folder):
    """Save a LeRobot checkpoint in half precision, with the language encoder's settings in `hypogeum.json`."""
    copy.deepcopy(policy).half().save_pretrained(folder)
    for processor in processors:
        processor.save_pretrained(folder)
    dim = policy.config.input_features[INSTRUCTION].shape[0]
    (folder / "hypogeum.json").write_text(json.dumps({"language": {"encoder": "hashed", "dim": dim}}) + "\n")


def evaluate(args, tasks):
    """Evaluate the exported checkpoint in closed loop and return {task: success_once}."""
    return success_rates(
        args.evaluate, f"act:{args.output}", tasks, episodes=args.episodes, seed=args.evaluation_seed,
        threads=args.threads, execute=args.chunk,
    )  # fmt: skip


def main():
    args = arguments()
    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    folder = args.output / "training"
    folder.mkdir(parents=True, exist_ok=True)
    data = Demonstrations(args.dataset, args.tasks and args.tasks.split(","), args.shrink, args.chunk, folder)
    policy = make_policy(args, data)
    processors = make_act_pre_post_processors(policy.config, data.stats())

    def prepare(step):
        return processors[0](data.batch(step, args.batch_size, args.seed))

    averaged = AveragedModel(policy, multi_avg_fn=get_ema_multi_avg_fn(args.ema))
    optimiser = torch.optim.AdamW(policy.parameters(), lr=args.lr, weight_decay=1e-4)
    state, first = folder / "state.pt", 0
    fixed = {name: getattr(args, name) for name in FIXED} | {"tasks": data.tasks}
    if state.exists():
        saved = torch.load(state, weights_only=True, map_location=args.device)
        for name, value in fixed.items():
            made_with = saved["fixed"].get(name)
            if made_with != value:
                sys.exit(f"{state} was made with {name} {made_with}, not {value}; choose another --output")
        for name, part in (("policy", policy), ("averaged", averaged), ("optimiser", optimiser)):
            part.load_state_dict(saved[name])
        first = saved["step"]
        print(f"resuming after step {first}")
    else:
        if args.init:
            load_weights(policy, args.init)
        else:
            calibrate(policy, prepare(0))
        averaged.module.load_state_dict(policy.state_dict())
    n_parameters = sum(parameter.numel() for parameter in policy.parameters())
    print(f"{', '.join(data.tasks)}: {data.n_frames} frames, {n_parameters / 1e6:.2f} M parameters", flush=True)

    policy.train()
    losses, start = [], time.monotonic()
    for step in range(first, args.steps):
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(step, args)
        torch.manual_seed(args.seed + step)
        loss, _ = policy(prepare(step))
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(policy.parameters(), 10)
        optimiser.step()
        averaged.update_parameters(policy)
        losses.append(loss.item())
        if not math.isfinite(losses[-1]):
            sys.exit(f"the loss of step {step} is {losses[-1]}; lower --lr and resume from the last checkpoint")
        done = step + 1
        if done % 100 == 0:
            rate = (done - first) * args.batch_size / (time.monotonic() - start)
            print(f"step {done} of {args.steps}: loss {np.mean(losses[-100:]):.4f}, {rate:.1f} samples/s", flush=True)
        if done % args.save_every == 0 or done == args.steps:
            export(averaged.module, processors, args.output)
            row = {"step": done, "loss": float(np.mean(losses)), "seconds": round(time.monotonic() - start, 1)}
            if args.evaluate:
                row["success_once"] = evaluate(args, data.tasks)
            losses.clear()
            with open(folder / "log.jsonl", "a") as log:
                log.write(json.dumps(row) + "\n")
            print(json.dumps(row), flush=True)
            # Saved last: after an interruption, unfinished work since the previous checkpoint is repeated.
            parts = {"policy": policy, "averaged": averaged, "optimiser": optimiser}
            saved = {name: part.state_dict() for name, part in parts.items()} | {"step": done, "fixed": fixed}
            torch.save(saved, folder / "new.pt")
            (folder / "new.pt").replace(state)


if __name__ == "__main__":
    try:
        with explained(INSTALL):
            main()
    except KeyboardInterrupt:
        sys.exit("\ninterrupted; the same command resumes from the last checkpoint")
