#!/usr/bin/env python3
"""Train a small π0.5 on demonstrations from `hypogeum demos`, from random weights.

    hypogeum demos -o demos --tasks RaiseCube,OpenDrawer
    train_pi05.py demos/single -o pi05-mine --binary target/release/hypogeum
    hypogeum run --policy pi05=pi05:pi05-mine --tasks RaiseCube,OpenDrawer --episodes 200

The network is LeRobot's own π0.5 with small widths: a SigLIP vision tower, a Gemma that reads images and prompt, and
an action expert that attends to it. `flow_loss` computes the loss of LeRobot's forward pass, but draws several noises
per observation and reads images and prompt only once for all of them. Eight things help a small network on few data:

- *Keyframes.* From the patches, a linear head of each task predicts the states in which a gripper's command changes
  next, which is where the robot will grasp or release. It makes the vision tower see places, as the pretrained one of
  π0.5 does already. With `--vision-steps`, the first steps train nothing else and take a third of the time.
- *Auxiliary prediction.* From the prompt's last token, a linear head predicts the action chunk and later states. It
  shapes the prefix, as the discrete action tokens do in π0.5's own training. Neither head is part of the checkpoint.
- *Aligned examples.* A policy that executes whole chunks is queried at multiples of their length. With `--aligned`, a
  fraction of the examples begins within one `--frame-stride` of such a frame.
- *Relative actions.* Target joint positions are offsets from the observed ones, as openpi's delta actions are.
- *Numbers that start as a curve.* The embeddings of the state numbers 0 to 255 are smooth in the number at first.
- *Paraphrases.* Instructions are drawn from the task's own sentence and three quarters of its paraphrases. The last
  quarter is held out.
- *Foreign instructions.* A fraction of the examples shows a scene with the instruction of a task that cannot be done
  in it. Their target is to hold still. These examples are not demonstrations: they make the policy read.
- *Muon.* It updates the matrices of all layers, and AdamW the rest. In the same nine minutes, 196 of its steps with 32
  observations lowered the loss slightly more than 559 steps of AdamW alone with 16.

Needs Python 3.12 and LeRobot 0.6 (`pip install './python[pi]' 'lerobot>=0.6' pyarrow`). After an interruption, the same
command resumes from the last checkpoint. The output folder is a LeRobot checkpoint of the averaged weights in bfloat16,
with its tokenizer; its sub-folder `training` holds what only training needs: images, optimiser state and log.
"""

import argparse
import io
import json
import re
import subprocess
import sys
import time
from pathlib import Path

from hypogeum.requirements import explained

STARTED = time.monotonic()
INSTALL = "pip install './python[pi]' 'lerobot>=0.6' pyarrow"
with explained(INSTALL):
    import numpy as np
    import torch
    from safetensors.torch import save_file

    from hypogeum.demonstrations import ACTION, IMAGES, STATE, TrainingFrames, prefetched
    from hypogeum.muon import Muon
    from hypogeum.pi05 import UNUSED, Widths, processors_of
    from hypogeum.pi05_training import (
        Auxiliary, distance, flow_loss, prompt, random_policy, scaled, see, split, tokenize, train_tokenizer, used,
    )  # fmt: skip
    from hypogeum.robot import state_slice
    from hypogeum.tokenizer import Tokenizer
    from hypogeum.training import CheckpointEvaluation, Training, add_arguments, load_weights
    from lerobot.configs.types import FeatureType, PolicyFeature
    from lerobot.policies.pi05.configuration_pi05 import PI05Config

PARAPHRASES = Path(__file__).parent.parent / "sim/src/tasks/paraphrases"
# LeRobot's forward pass requires eight query heads.
N_HEADS = 8
# Number of tokens after which a checkpoint's prompts are cut off.
MAX_TOKENS = 96
# Inputs per morphology: cameras and parts of the state.
CAMERAS = {
    "single": {"external1": "external1_camera", "hand": "hand_camera"},
    "bimanual": {
        "external2": "external2_camera",
        "panda1_hand": "panda1_hand_camera",
        "panda2_hand": "panda2_hand_camera",
    },
}
# The first numbers of the state correspond to those of an action that sets joint positions: arm by arm, seven
# joints and a finger. In the state vector, two arms are interleaved.
STATE_PARTS = {
    "single": ["qpos", "tcp_pose"],
    "bimanual": [f"qpos[{joint}:{joint + 1}]" for arm in range(2) for joint in range(arm, 16, 2)],
}
# Part of the names of those entries of an action that are never relative to the state.
GRIPPER = "gripper"
# Instructions that another task's scene permits, so that they are never foreign in it.
POSSIBLE = {"StackCube": {"RaiseCube"}, "PlaceCubeInDrawer": {"OpenDrawer"}}
# Number of frames at an episode's start from which half of the foreign examples are drawn.
N_START_FRAMES = 20
# Frames ahead at which the auxiliary head predicts the state; the last one is the episode's end.
LATER = (15, 40, 10_000)
# Number of states that are predicted from the patches.
N_PLACES = 3
AUXILIARY_WEIGHT = 0.5
# Lower bound on the width of a range to which actions are scaled.
MIN_RANGE = 0.02
# Approximate number of rows of actions from which their range is taken.
N_ROWS = 100_000
# Upper bound on a scaled action entry, for all but the rarest rows.
MAX_SCALED = 3.0
WARM_UP_STEPS = 200
WEIGHT_DECAY = 1e-2
# Fraction of all steps over which the learning rate decays to zero.
COOL_DOWN = 0.3
# Arguments that must not change when training resumes.
FIXED = (
    "tasks", "frame_stride", "side", "vision", "vision_layers", "vision_heads", "vision_mlp", "prefix", "prefix_mlp",
    "expert", "expert_mlp", "layers", "head_dim", "chunk", "vocabulary",
)  # fmt: skip


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser, steps=10_000, batch_size=32, lr=6e-4, frame_stride=3)
    parser.add_argument("--binary", required=True, metavar="HYPOGEUM", help="binary that lists and evaluates tasks")
    parser.add_argument("--tasks", help="comma-separated tasks with optional weights, as in RaiseCube=2,OpenDrawer")
    parser.add_argument("--vision-steps", type=int, default=0, help="number of first steps that train only vision")
    parser.add_argument("--parts", type=int, default=1, help="parts of a batch to compute one after the other")
    parser.add_argument("--draws", type=int, default=4, help="noises per observation")
    parser.add_argument("--aligned", type=float, default=0, help="fraction of examples close to multiples of --chunk")
    parser.add_argument("--foreign", type=float, default=0.15, help="fraction of examples with a foreign instruction")
    parser.add_argument("--side", type=int, default=84, help="side of the images, a multiple of 14")
    parser.add_argument("--vision", type=int, default=128, help="width of the vision tower")
    parser.add_argument("--vision-layers", type=int, default=4)
    parser.add_argument("--vision-heads", type=int, default=4)
    parser.add_argument("--vision-mlp", type=int, default=384)
    parser.add_argument("--prefix", type=int, default=192, help="width of the Gemma that reads images and prompt")
    parser.add_argument("--prefix-mlp", type=int, default=384)
    parser.add_argument("--expert", type=int, default=128, help="width of the action expert")
    parser.add_argument("--expert-mlp", type=int, default=384)
    parser.add_argument("--layers", type=int, default=4, help="layers of prefix and expert")
    parser.add_argument("--head-dim", type=int, default=32)
    parser.add_argument("--vocabulary", type=int, default=1024, help="number of tokens")
    parser.add_argument("--chunk", type=int, default=16, help="rows of an action chunk")
    parser.add_argument("--denoising-steps", type=int, default=10, help="default of the checkpoint")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument(
        "--precision", choices=["f32", "bf16"], help="precision of the network in training (default: bf16 on a GPU)"
    )
    parser.add_argument("--compile", action="store_true", help="compile the loss, which takes a minute or two")
    parser.add_argument("--evaluate", action="store_true", help="evaluate every checkpoint in closed loop")
    parser.add_argument("--execute", type=int, default=15, help="rows of a chunk to execute in an evaluation")
    args = parser.parse_args()
    args.precision = args.precision or ("bf16" if args.device.startswith("cuda") else "f32")
    return args


def read_instructions(binary, morphology):
    """Return {task: sentences} for all tasks of a morphology; the task's own sentence is the first.

    The last quarter of the paraphrases is left out.
    """
    tasks = json.loads(subprocess.run([binary, "tasks", "--json"], check=True, capture_output=True).stdout)["tasks"]
    instructions = {}
    for task in tasks:
        if task["morphology"] == morphology:
            name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", task["task"]).lower()
            paraphrases = (PARAPHRASES / f"{name}.txt").read_text().splitlines()
            instructions[task["task"]] = [task["instruction"], *paraphrases[: len(paraphrases) * 3 // 4]]
    return instructions


# Data


class Examples(TrainingFrames):
    """Demonstrations with the batches and statistics of π0.5.

    Args:
        weights: {task: weight in a batch}, or empty for all tasks with equal weights.
        args: Command line arguments.
        cache: Folder for the decoded images.
    """

    def __init__(self, weights, args, cache):
        settings = args.dataset / "meta/hypogeum.json"
        self.morphology = json.loads(settings.read_text())["morphology"] if settings.exists() else "single"
        super().__init__(
            args.dataset, weights, cache, size_of=lambda *_: (args.side, args.side), stride=args.frame_stride,
            cameras=[f"{IMAGES}{name}" for name in CAMERAS[self.morphology]], vectors=(STATE, ACTION),
            processes=args.threads,
        )  # fmt: skip
        self.weights = {task: weights.get(task, 1.0) for task in self.tasks}
        info = json.loads((args.dataset / "meta/info.json").read_text())
        self.action_names = info["features"][ACTION]["names"]
        mode = self.settings["control_mode"]
        if mode == "pd_ee_pose":
            sys.exit(
                f"{args.dataset} was recorded with {mode}: expected pd_ee_delta_pose or pd_joint_pos; record it again"
            )
        self.is_relative = mode == "pd_joint_pos"
        self.select_states()
        self.chunk = args.chunk
        # Indices into the observed frames, by task: all, those at the start of an episode, and those close to
        # where a policy that executes whole chunks is queried.
        observed_task, age = self.task_of[self.observed], self.observed - self.starts[self.observed]
        self.by_task = [np.flatnonzero(observed_task == idx) for idx in range(len(self.tasks))]
        self.at_start = [
            np.flatnonzero((observed_task == idx) & (age < N_START_FRAMES)) for idx in range(len(self.tasks))
        ]
        is_aligned = (age + args.frame_stride) % args.chunk <= 2 * args.frame_stride
        self.aligned = [np.flatnonzero((observed_task == idx) & is_aligned) for idx in range(len(self.tasks))]

    def select_states(self):
        """Take from the vectors what the network reads."""
        parts = [state_slice(self.morphology, part) for part in STATE_PARTS[self.morphology]]
        self.states = torch.cat([self.vectors[STATE][:, part] for part in parts], dim=1)
        self.actions = self.vectors[ACTION]
        self.is_gripper = torch.tensor([GRIPPER in name for name in self.action_names], device=self.actions.device)
        self.keyframes = self.find_keyframes()

    def find_keyframes(self):
        """Return, for each frame, the next one in which a gripper's command changes, or else the episode's last."""
        grippers = self.actions[:, self.is_gripper]
        is_open = grippers > (grippers.amax(0) + grippers.amin(0)) / 2
        last = torch.as_tensor(self.ends, device=is_open.device) - 1
        frames = torch.arange(len(last), device=last.device)
        is_keyframe = frames == last
        is_keyframe[1:] |= (is_open[1:] != is_open[:-1]).any(1) & (last[1:] == last[:-1])
        found = torch.nonzero(is_keyframe)[:, 0]
        return found[torch.searchsorted(found, torch.minimum(frames + 1, last))]

    def places(self, frames):
        """Return the frames whose states are predicted from the patches: the next two keyframes, and themselves."""
        keyframes = self.keyframes[frames]
        return torch.stack([keyframes, self.keyframes[keyframes], frames], dim=1)

    def place(self, device):
        """Move everything to a device. Return whether the images are there, as bytes, because they fit."""
        is_resident = super().place(device)
        self.select_states()
        return is_resident

    def stats(self):
        """Return the ranges that become [-1, 1]: more than all states, and most of the actions.

        Without a margin, a state below its range would become a negative number, which no prompt in training contains.
        """
        low, high = self.states.amin(0), self.states.amax(0)
        margin = 0.15 * (high - low) + 1e-3
        stats = {STATE: {"q01": low - margin, "q99": high + margin}}
        step = max(1, self.n_frames * self.chunk // N_ROWS)
        frames = torch.arange(0, self.n_frames, step, device=self.actions.device)
        actions = self.chunks(frames).flatten(0, 1)
        q01, q99 = (torch.quantile(actions, q, dim=0) for q in (0.01, 0.99))
        # Rare large rotations would otherwise dominate the squared error.
        centre, half = (q01 + q99) / 2, ((q99 - q01) / 2).clamp_min(MIN_RANGE / 2)
        half = torch.maximum(half, (actions - centre).abs().amax(0) / MAX_SCALED)
        stats[ACTION] = {"q01": centre - half, "q99": centre + half}
        return {name: {q: bound.cpu() for q, bound in bounds.items()} for name, bounds in stats.items()}

    def chunks(self, frames):
        """Return the chunks of actions from frames on, `[n, chunk, action_dim] f32`; positions relative to the state.

        After the end of an episode, its last action is repeated.
        """
        last = self.ends[frames][:, None] - 1
        rows = self.actions[torch.minimum(frames[:, None] + torch.arange(self.chunk, device=last.device), last)]
        if self.is_relative:
            rows = torch.where(self.is_gripper, rows, rows - self.states[frames][:, None, : rows.shape[2]])
        return rows

    def hold_still(self, frames):
        """Return the chunks that keep the robot where it is in these frames, `[n, chunk, action_dim] f32`."""
        return (self.actions[frames] * self.is_gripper)[:, None].expand(-1, self.chunk, -1)

    def batch(self, step, args, instructions):
        """Return the batch of a training step, a function of the arguments alone, with images as bytes."""
        random = np.random.default_rng([args.seed, step])
        weights = np.array(list(self.weights.values()))
        tasks = random.choice(len(self.tasks), args.batch_size, p=weights / weights.sum())
        foreign = random.random(args.batch_size) < args.foreign
        observed, texts = [], []
        for task_idx, is_foreign in zip(tasks, foreign):
            pools = self.aligned if random.random() < args.aligned else self.by_task
            pool, name = pools[task_idx], self.tasks[task_idx]
            if is_foreign:
                if random.random() < 0.5:
                    pool = self.at_start[task_idx]
                name = random.choice(sorted(instructions.keys() - {name} - POSSIBLE.get(name, set())))
            observed.append(random.choice(pool))
            sentences = instructions[name]
            texts.append(sentences[0 if random.random() < 0.4 else random.integers(len(sentences))])
        device = self.states.device
        frames = self.observed[torch.as_tensor(np.array(observed), device=device)]
        last = self.ends[frames][:, None] - 1
        actions = self.chunks(frames)
        later = self.states[torch.minimum(frames[:, None] + torch.tensor(LATER, device=device), last)]
        states, foreign = self.states[frames], torch.from_numpy(foreign).to(device)[:, None, None]
        return {
            "images": torch.stack(list(self.gather(observed).values()), dim=1),
            "texts": texts,
            STATE: states,
            ACTION: torch.where(foreign, self.hold_still(frames), actions),
            "later": torch.where(foreign, states[:, None], later),
            "places": self.states[self.places(frames)],
            "tasks": torch.from_numpy(tasks),
        }


# Network


def make_config(args, cameras, state_dim, action_names, is_relative):
    """Return LeRobot's configuration. The action is not padded, so that the expert sees no noise that it ignores."""
    action_dim = len(action_names)
    images = {name: PolicyFeature(FeatureType.VISUAL, (3, args.side, args.side)) for name in cameras}
    return PI05Config(
        input_features={**images, STATE: PolicyFeature(FeatureType.STATE, (state_dim,))},
        output_features={ACTION: PolicyFeature(FeatureType.ACTION, (action_dim,))},
        image_resolution=(args.side, args.side),
        chunk_size=args.chunk, n_action_steps=min(args.execute, args.chunk), max_state_dim=state_dim,
        max_action_dim=action_dim, tokenizer_max_length=MAX_TOKENS, device="cpu", push_to_hub=False,
        num_inference_steps=args.denoising_steps, use_relative_actions=is_relative, relative_exclude_joints=[GRIPPER],
        action_feature_names=action_names,
    )  # fmt: skip


def widths_of(args):
    """Return the sizes of the network."""
    vision = {
        "hidden_size": args.vision, "num_hidden_layers": args.vision_layers,
        "num_attention_heads": args.vision_heads, "intermediate_size": args.vision_mlp,
    }  # fmt: skip
    heads = {"depth": args.layers, "num_heads": N_HEADS, "head_dim": args.head_dim}
    prefix = {"width": args.prefix, "mlp_dim": args.prefix_mlp, **heads}
    expert = {"width": args.expert, "mlp_dim": args.expert_mlp, **heads}
    return Widths(vision, prefix, expert, args.vocabulary)


# Training


def export(policy, processors, tokenizer, args, morphology, folder):
    """Save a LeRobot checkpoint in bfloat16, with the tokenizer and what LeRobot's files do not say."""
    folder.mkdir(parents=True, exist_ok=True)
    policy.config.save_pretrained(folder)
    tensors = {name: x.bfloat16().contiguous() for name, x in policy.state_dict().items() if not name.endswith(UNUSED)}
    save_file(tensors, folder / "new.safetensors")
    (folder / "new.safetensors").replace(folder / "model.safetensors")
    for processor in processors:
        processor.save_pretrained(folder)
    (folder / "tokenizer.model").write_bytes(tokenizer)
    mapping = {f"{IMAGES}{name}": camera for name, camera in CAMERAS[morphology].items()}
    sidecar = {"vision_heads": args.vision_heads, "mapping": {**mapping, STATE: STATE_PARTS[morphology]}}
    (folder / "hypogeum.json").write_text(json.dumps(sidecar, indent=2) + "\n")


def parse_weights(text):
    """Parse `RaiseCube=2,OpenDrawer` to {task: weight}."""
    pairs = (item.partition("=") for item in text.split(",")) if text else ()
    return {name: float(weight or 1) for name, _, weight in pairs}


def main():
    args = arguments()
    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    folder = args.output / "training"
    folder.mkdir(parents=True, exist_ok=True)
    data = Examples(parse_weights(args.tasks), args, folder)
    is_resident = data.place(args.device)
    stats = data.stats()
    instructions = read_instructions(args.binary, data.morphology)
    model_path = Path(args.init or args.output) / "tokenizer.model"
    model = model_path.read_bytes() if model_path.exists() else train_tokenizer(instructions, args.vocabulary)
    tokenizer = Tokenizer.from_sentencepiece(model)
    config = make_config(args, list(data.cameras), data.states.shape[1], data.action_names, data.is_relative)
    policy, averaged = (random_policy(widths_of(args), config, tokenizer) for _ in range(2))
    if args.init:
        load_weights(policy, args.init, optional=UNUSED)
    averaged.load_state_dict(policy.state_dict())
    processors = processors_of(config, stats, tokenizer)
    state_dim, n_patches = data.states.shape[1], len(data.cameras) * (args.side // 14) ** 2
    n_summary = args.chunk * data.actions.shape[1] + len(LATER) * state_dim
    auxiliary = Auxiliary(args.prefix, n_summary, len(data.tasks), n_patches, N_PLACES * state_dim)
    for network in (policy, averaged, auxiliary):
        network.to(args.device)
    matrices, others = split(policy, auxiliary)
    optimisers = {
        "muon": Muon(matrices, lr=args.lr, weight_decay=WEIGHT_DECAY),
        "adamw": torch.optim.AdamW(others, lr=args.lr, weight_decay=WEIGHT_DECAY, betas=(0.9, 0.95)),
    }
    parts = {"policy": policy, "averaged": averaged, "auxiliary": auxiliary, **optimisers}
    fixed = {name: getattr(args, name) for name in FIXED} | {"tasks": data.tasks}
    training = Training(args, parts, fixed, losses=["places", "flow", "summary"])
    n_parameters = sum(parameter.numel() for name, parameter in used(policy))
    print(f"{', '.join(data.tasks)}: {data.n_frames} frames, {n_parameters / 1e6:.2f} M parameters", flush=True)

    evaluate = args.evaluate and CheckpointEvaluation(
        "pi05", data.tasks, folder, episodes=args.episodes, seed=args.evaluation_seed, execute=args.execute,
        options=("--threads", str(args.threads)), program=args.binary,
    )  # fmt: skip
    policy.train()
    seen, loss_of = (torch.compile(function) if args.compile else function for function in (see, flow_loss))
    state_range, action_range = ({q: x.to(args.device) for q, x in stats[key].items()} for key in (STATE, ACTION))

    prompts = [prompt(text, [0] * state_dim) for texts in instructions.values() for text in texts]
    length = max(len(tokenizer.encode(text)) for text in prompts)

    def batch_of(step):
        batch = data.batch(step, args, instructions)
        vision = batch["images"], batch["tasks"], scaled(batch["places"], state_range)
        if step < args.vision_steps:
            return vision
        states = scaled(batch[STATE], state_range)
        tokens, mask = tokenize(tokenizer, batch["texts"], states, length)
        return *vision, tokens, mask, scaled(batch[ACTION], action_range), scaled(batch["later"], state_range)

    def gradients(batch):
        policy.zero_grad()
        auxiliary.zero_grad()
        parts = zip(*(tensor.chunk(args.parts) for tensor in batch), strict=True)
        return sum(gradients_of_part(*part) for part in parts)

    def gradients_of_part(images, tasks, places, *rest):
        with torch.autocast(places.device.type, torch.bfloat16, enabled=args.precision == "bf16"):
            patches = seen(policy.model, images.float() / 127.5 - 1)
            losses = [distance(auxiliary.places(patches, tasks.tolist()), places.flatten(1))]
            if rest:
                tokens, mask, actions, later = rest
                noise = torch.randn(len(actions), args.draws, *actions.shape[1:], device=args.device)
                t = policy.model.sample_time(len(actions) * args.draws, args.device).view(len(actions), -1)
                errors, summary = loss_of(policy.model, patches, tokens, mask, actions, noise, t)
                targets = torch.cat([actions.flatten(1), later.flatten(1)], dim=1)
                losses += [errors.mean(), distance(auxiliary.summary(summary), targets)]
        losses = torch.stack(losses) * len(images) / args.batch_size
        weights = torch.tensor([AUXILIARY_WEIGHT, 1, AUXILIARY_WEIGHT], device=losses.device)
        (losses * weights[: len(losses)]).sum().backward()
        return losses.detach()

    is_ahead = args.device.startswith("cuda") or not is_resident
    training.run(
        lambda steps: prefetched(batch_of, steps) if is_ahead else map(batch_of, steps),
        gradients,
        lambda output: export(averaged, processors, model, args, data.morphology, output),
        warm_up=WARM_UP_STEPS, cool_down=COOL_DOWN, max_norm=1, evaluate=evaluate, started=STARTED,
    )  # fmt: skip


if __name__ == "__main__":
    try:
        with explained(INSTALL):
            main()
    except KeyboardInterrupt:
        sys.exit("\ninterrupted; the same command resumes from the last checkpoint")
