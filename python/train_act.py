#!/usr/bin/env python3
"""Train LeRobot's ACT on demonstrations from `hypogeum demos` and evaluate every checkpoint in the simulator.

    hypogeum demos -o demos --tasks RaiseCube --episodes 100
    train_act.py demos/single -o raise-cube --evaluate target/release/hypogeum
    hypogeum run --policy act=act:raise-cube --tasks RaiseCube --episodes 200

Needs Python 3.12 and LeRobot 0.6 (`pip install './python[lerobot]' pyarrow`). Uses a GPU if there is one: then the
network computes in bfloat16, and images stay in the GPU's memory if they fit. `--max-minutes` limits the time of the
whole command; the learning rate decays towards its end. `--shrink` is not needed for `hypogeum demos --shrink`. After
an interruption, the same command resumes from the last checkpoint. The output folder is a LeRobot checkpoint of the
averaged weights in half precision; its sub-folder `training` holds what only training needs: images, optimiser state
and log.
"""

import argparse
import copy
import json
import sys
import time

from hypogeum.requirements import explained

STARTED = time.monotonic()
INSTALL = "pip install './python[lerobot]' pyarrow"
with explained(INSTALL):
    import numpy as np
    import torch
    import torch.nn.functional as F
    from torchvision.ops.misc import FrozenBatchNorm2d

    from hypogeum.backbone import resnet18_of
    from hypogeum.demonstrations import ACTION, INSTRUCTION, STATE, TrainingFrames, prefetched, shuffled
    from hypogeum.training import CheckpointEvaluation, Training, add_arguments, load_weights
    from lerobot.configs.types import FeatureType, PolicyFeature
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.act.modeling_act import ACTPolicy
    from lerobot.policies.act.processor_act import make_act_pre_post_processors
    from lerobot.utils.constants import OBS_IMAGES

# Lower bound on the standard deviations by which vectors are divided, as in the benchmark's own training.
MIN_STD = 0.01
WARM_UP_STEPS = 500
# Fraction of all steps over which the learning rate decays to zero.
COOL_DOWN = 0.25
# Steps before a CUDA graph is captured.
EAGER_STEPS = 5
# Side in pixels of the images from which the batch statistics are computed.
CALIBRATION_SIDE = 64
# Arguments that must not change when training resumes.
FIXED = (
    "tasks", "frame_stride", "batch_size", "width", "shrink", "dim", "layers", "chunk", "dropout", "vae", "ema", "seed",
    "init",
)  # fmt: skip


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser, steps=20_000, batch_size=16, lr=2e-4, frame_stride=1)
    parser.add_argument("--tasks", help="comma-separated task names (default: all in the dataset)")
    parser.add_argument("--width", type=int, default=64, help="channels of the ResNet-18's first stage; usually 64")
    parser.add_argument("--shrink", type=int, default=1, help="factor by which images are downscaled")
    parser.add_argument("--dim", type=int, default=512, help="width of the transformer")
    parser.add_argument("--layers", type=int, default=4, help="number of encoder layers")
    parser.add_argument("--dropout", type=float, default=0.1, help="dropout rate of the transformer")
    parser.add_argument("--chunk", type=int, default=30, help="rows of an action chunk")
    parser.add_argument("--vae", action="store_true", help="train with ACT's latent variable; scripted demos need none")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument(
        "--precision", choices=["f32", "bf16"], help="precision of the network in training (default: bf16 on a GPU)"
    )
    parser.add_argument("--evaluate", metavar="HYPOGEUM", help="binary with which to evaluate every checkpoint")
    args = parser.parse_args()
    args.precision = args.precision or ("bf16" if args.device.startswith("cuda") else "f32")
    return args


class Examples(TrainingFrames):
    """Demonstrations with the batches and statistics of ACT."""

    def stats(self):
        """Return means and standard deviations, of vectors per element and of images per channel."""
        stats = {}
        for key, values in self.vectors.items():
            stats[key] = {"mean": values.mean(0), "std": values.std(0).clamp_min(MIN_STD)}
        for key, images in self.images.items():
            sample = images[:: max(1, len(images) // 2000)].numpy()
            counts = np.stack([np.bincount(sample[..., channel].ravel(), minlength=256) for channel in range(3)])
            shares, levels = counts / counts.sum(1, keepdims=True), np.arange(256) / 255
            mean = shares @ levels
            moments = {"mean": mean, "std": np.sqrt((shares * (levels - mean[:, None]) ** 2).sum(1))}
            stats[key] = {name: torch.tensor(value).float()[:, None, None] for name, value in moments.items()}
        return stats

    def batch(self, step, size, chunk, seed):
        """Return the batch of a training step, a function of the arguments alone, with images as bytes.

        An epoch visits every observed frame once.
        """
        n = len(self.observed)
        order, place = shuffled(n, seed, step // (n // size)), step % (n // size)
        observed = torch.from_numpy(np.sort(order[place * size :][:size]))
        batch = self.gather(observed)
        frames = self.observed[observed.to(self.observed.device, non_blocking=True)]
        future = frames[:, None] + torch.arange(chunk, device=frames.device)
        last = self.ends[frames][:, None] - 1
        batch |= {key: self.vectors[key][frames] for key in (STATE, INSTRUCTION)}
        batch[ACTION] = self.vectors[ACTION][torch.minimum(future, last)]
        batch["action_is_pad"] = future > last
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


def loss_of(policy, batch, precision):
    """Return the loss of LeRobot's `ACTPolicy.forward`, which also copies it to the host."""
    batch = batch | {OBS_IMAGES: [batch[key] for key in policy.config.image_features]}
    device, is_half = batch[ACTION].device, precision == "bf16"
    # Casts of weights must not outlive a graph's capture, so they are not cached.
    # LeRobot makes zeros on the default device and copies them, which a graph must not do.
    with torch.device(device), torch.autocast(device.type, torch.bfloat16, enabled=is_half, cache_enabled=False):
        actions, (mean, log_variance) = policy.model(batch)
    errors = F.l1_loss(batch[ACTION], actions.float(), reduction="none")
    valid = ~batch["action_is_pad"][..., None]
    loss = (errors * valid).sum() / (valid.sum() * errors.shape[-1]).clamp_min(1)
    if mean is not None:
        divergence = -0.5 * (1 + log_variance - mean.pow(2) - log_variance.exp()).sum(-1).mean()
        loss = loss + divergence * policy.config.kl_weight
    return loss


def fuse(norm, dtype):
    """Replace the computation of a frozen batch normalisation by one kernel that takes and returns this type."""
    scale = norm.weight * (norm.running_var + norm.eps).rsqrt()
    shift = norm.bias - norm.running_mean * scale
    shift, scale = (values.to(dtype)[:, None, None] for values in (shift, scale))
    norm.forward = lambda x: torch.addcmul(shift, x, scale)


class Gradients:
    """Computation of a batch's loss and gradients, on a GPU as a CUDA graph, which costs one launch per step."""

    def __init__(self, policy, precision):
        self.policy, self.precision, self.graph = policy, precision, None
        is_cuda = next(policy.parameters()).is_cuda
        self.n_eager, self.stream = (0, torch.cuda.Stream()) if is_cuda else (None, None)

    def __call__(self, batch):
        """Set the gradients of all parameters and return the loss."""
        if self.n_eager == EAGER_STEPS:
            self.n_eager = None
            self.capture(batch)
        if self.graph:
            for key, values in self.batch.items():
                values.copy_(batch[key])
            self.graph.replay()
            return self.loss.clone()
        self.policy.zero_grad()
        if self.n_eager is None:
            return self.backward(batch)
        # Capturing asks for a few steps on a stream of their own.
        self.n_eager += 1
        self.stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(self.stream):
            loss = self.backward(batch)
        torch.cuda.current_stream().wait_stream(self.stream)
        return loss

    def backward(self, batch):
        loss = loss_of(self.policy, batch, self.precision)
        loss.backward()
        return loss.detach()[None]

    def capture(self, batch):
        """Record the computation. If that fails, the steps go on as they are."""
        self.policy.zero_grad()
        tensors = {key: values.clone() for key, values in batch.items() if isinstance(values, torch.Tensor)}
        try:
            torch.cuda.synchronize()
            torch.cuda.empty_cache()
            graph = torch.cuda.CUDAGraph()
            with torch.cuda.graph(graph, capture_error_mode="thread_local"):
                loss = self.backward(tensors)
        except Exception as error:
            self.policy.zero_grad()
            print(f"no CUDA graph, steps take longer: {type(error).__name__}: {error}", flush=True)
        else:
            self.graph, self.batch, self.loss = graph, tensors, loss


def export(policy, processors, folder):
    """Save a LeRobot checkpoint in half precision, with the language encoder's settings in `hypogeum.json`."""
    copy.deepcopy(policy).half().to(memory_format=torch.contiguous_format).save_pretrained(folder)
    for processor in processors:
        processor.save_pretrained(folder)
    dim = policy.config.input_features[INSTRUCTION].shape[0]
    (folder / "hypogeum.json").write_text(json.dumps({"language": {"encoder": "hashed", "dim": dim}}) + "\n")


def make_data(args, cache):
    """Return the demonstrations, and their statistics before they leave the CPU."""
    data = Examples(
        args.dataset, args.tasks and args.tasks.split(","), cache, stride=args.frame_stride, processes=args.threads,
        size_of=lambda *sides: [side // args.shrink for side in sides],
    )  # fmt: skip
    if len(data.observed) < args.batch_size:
        sys.exit(f"--batch-size {args.batch_size} exceeds the {len(data.observed)} frames of the dataset")
    return data, data.stats()


def main():
    args = arguments()
    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    folder = args.output / "training"
    folder.mkdir(parents=True, exist_ok=True)
    data, stats = make_data(args, folder)
    is_resident = data.place(args.device)
    policy = make_policy(args, data)
    processors = make_act_pre_post_processors(policy.config, stats)

    def prepare(batch):
        return processors[0](batch | {key: batch[key] / 255 for key in data.cameras})

    def batch_of(step):
        return data.batch(step, args.batch_size, args.chunk, args.seed)

    averaged = copy.deepcopy(policy)
    is_fused = args.device.startswith("cuda")
    optimiser = torch.optim.AdamW(policy.parameters(), lr=args.lr, weight_decay=1e-4, fused=is_fused)
    fixed = {name: getattr(args, name) for name in FIXED} | {"tasks": data.tasks}
    parts = {"policy": policy, "averaged": averaged, "optimiser": optimiser}
    training = Training(args, parts, fixed, losses=["loss"])
    if training.first == 0:
        if args.init:
            load_weights(policy, args.init)
        else:
            calibrate(policy, prepare(batch_of(0)))
        averaged.load_state_dict(policy.state_dict())
    torch.backends.cudnn.benchmark = True
    if args.precision == "bf16":
        for norm in policy.modules():
            if isinstance(norm, FrozenBatchNorm2d):
                fuse(norm, torch.bfloat16)
        for network in (policy, averaged):
            network.model.backbone.to(memory_format=torch.channels_last)
    n_parameters = sum(parameter.numel() for parameter in policy.parameters())
    print(f"{', '.join(data.tasks)}: {data.n_frames} frames, {n_parameters / 1e6:.2f} M parameters", flush=True)

    evaluate = args.evaluate and CheckpointEvaluation(
        "act", data.tasks, folder, episodes=args.episodes, seed=args.evaluation_seed, execute=args.chunk,
        options=("--threads", str(args.threads)), program=args.evaluate,
    )  # fmt: skip
    policy.train()
    gradients = Gradients(policy, args.precision)
    training.run(
        lambda steps: map(batch_of, steps) if is_resident else prefetched(batch_of, steps),
        lambda batch: gradients(prepare(batch)),
        lambda output: export(averaged, processors, output),
        warm_up=WARM_UP_STEPS, cool_down=COOL_DOWN, max_norm=10, evaluate=evaluate, started=STARTED,
    )  # fmt: skip


if __name__ == "__main__":
    try:
        with explained(INSTALL):
            main()
    except KeyboardInterrupt:
        sys.exit("\ninterrupted; the same command resumes from the last checkpoint")
