"""What the training scripts share: the loop, its schedule and state, averaged weights, and closed-loop evaluation."""

import json
import math
import os
import sys
import time
from pathlib import Path

from .evaluation import evaluate
from .program import EvaluationError
from .results import Results

# Steps between two lines of progress, at which the losses are read.
LOG_STEPS = 100
# Seconds that saving the last checkpoint may take.
SAVING_S = 4


class Schedule:
    """Learning rate of a training bounded by steps, by time, or by both: warm-up, constant, linear decay to zero.

    Because the rate is constant in between, a run can be extended with more steps.

    Args:
        rate: Constant learning rate.
        steps: Number of steps.
        warm_up: Steps of the warm-up.
        cool_down: Fraction of the training over which the rate decays.
        seconds: Time from now on in which the training ends, if it has a limit.
        clock: Function that returns seconds.
    """

    def __init__(self, rate, steps, *, warm_up, cool_down, seconds=None, clock=time.monotonic):
        self.rate, self.steps, self.warm_up, self.cool_down = rate, steps, warm_up, cool_down
        self.seconds, self.clock, self.start = seconds, clock, clock()

    def progress(self, step):
        """Return the fraction of the training before a step: that of the steps or of the time, whichever is larger."""
        of_steps = step / self.steps
        if self.seconds is None:
            return of_steps
        return max(of_steps, (self.clock() - self.start) / self.seconds if self.seconds > 0 else 1)

    def rate_at(self, step, progress):
        """Return the learning rate of a step."""
        return self.rate * max(min((step + 1) / self.warm_up, (1 - progress) / self.cool_down, 1), 0)


def update_average(averaged, policy, step, decay):
    """Move the averaged weights towards those after a step; early steps count more."""
    import torch

    weight = 1 - min(decay, (1 + step) / (10 + step))
    with torch.no_grad():
        torch._foreach_lerp_(list(averaged.parameters()), list(policy.parameters()), weight)


def load_weights(policy, folder, optional=()):
    """Load the weights of a checkpoint that a training script has written; its network must have the same shape.

    Tensors whose names end with one of `optional` may be absent.
    """
    from safetensors.torch import load_file

    path = Path(folder) / "model.safetensors"
    if not path.is_file():
        sys.exit(f"{path} does not exist: expected a checkpoint folder of this script")
    weights = load_file(path)
    expected = {name: tuple(value.shape) for name, value in policy.state_dict().items()}
    found = {name: tuple(value.shape) for name, value in weights.items()}
    for name in sorted(expected.keys() | found.keys()):
        is_absent = name not in found and name.endswith(tuple(optional))
        if expected.get(name) != found.get(name) and not is_absent:
            sys.exit(f"{path}: {name} has shape {found.get(name)}, expected {expected.get(name)}")
    policy.load_state_dict(weights, strict=False)


class CheckpointEvaluation:
    """Evaluation of a training's checkpoints in the simulator, each compared with the best one before.

    Args:
        kind: Kind of the policy's spec, for example `act`.
        tasks: Task names.
        folder: Folder for the results of the best checkpoint, in which an evaluation after an interruption finds them.
        options: Further arguments of `hypogeum.evaluate`.
    """

    def __init__(self, kind, tasks, folder, **options):
        self.kind, self.tasks, self.options = kind, tasks, options
        self.best, self.newest = folder / "best.db", folder / "newest.db"

    def __call__(self, step, checkpoint):
        """Return what the log says of a checkpoint folder; exits with the program's message if that fails.

        This is `success_once` per task, whether the mean is at least that of the best one before (`is_best`), and, if
        there is one, the verdict `than_best`.
        """
        self.newest.unlink(missing_ok=True)
        try:
            results = evaluate(
                f"{self.kind}:{checkpoint}", self.tasks, name=f"step-{step}", db=self.newest, quiet=True, **self.options
            )
            row = {"success_once": {cell.task: cell.rate for cell in results.cells}, "is_best": True}
            if self.best.exists():
                comparison = results.compare(Results(self.best, program=self.options.get("program")))
                row |= {"than_best": comparison.verdict, "is_best": comparison.difference >= 0}
                print(comparison, flush=True)
        except EvaluationError as error:
            sys.exit(f"error: {error}")
        if row["is_best"]:
            self.newest.replace(self.best)
        return row


class Training:
    """A training that resumes after interruptions, to the bit.

    Its folder is `training` in the output folder. The checkpoint in the output folder is the last one or, with
    evaluation, the best one.

    Args:
        args: Command line arguments of the script.
        parts: What a step changes, by name: `policy`, `averaged`, the optimisers, and others with a `state_dict`.
        fixed: {name: value} of what must be the same when training resumes.
        losses: Names of the losses; the last ones may be absent from some steps.

    Attributes:
        first: Number of steps done before.
    """

    def __init__(self, args, parts, fixed, losses):
        self.args, self.parts, self.fixed, self.losses, self.first = args, parts, fixed, losses, 0
        self.folder = args.output / "training"
        self.state = self.folder / "state.pt"
        if self.state.exists():
            self.resume()

    def resume(self):
        """Restore the state of the last checkpoint."""
        import torch

        saved = torch.load(self.state, weights_only=True, map_location=getattr(self.args, "device", None))
        for name, value in self.fixed.items():
            made_with = saved["fixed"].get(name)
            if made_with != value:
                sys.exit(f"{self.state} was made with {name} {made_with}, not {value}; choose another --output")
        for name, part in self.parts.items():
            part.load_state_dict(saved[name])
        self.first = saved["step"]
        print(f"resuming after step {self.first}", flush=True)

    def run(self, batches, gradients, export, *, warm_up, cool_down, max_norm, evaluate=None, started=None):
        """Train until the last step or the time limit.

        Args:
            batches: Function from a range of steps to their batches.
            gradients: Function that sets the gradients for a batch and returns the losses as a tensor.
            export: Function that writes a checkpoint of the averaged weights into a folder.
            warm_up: Steps of the warm-up.
            cool_down: Fraction of the training over which the learning rate decays.
            max_norm: Upper bound on the norm of all gradients together.
            evaluate: A `CheckpointEvaluation`.
            started: Time at which the time limit began, as of `time.monotonic`.
        """
        import torch

        args = self.args
        optimisers = [part for part in self.parts.values() if isinstance(part, torch.optim.Optimizer)]
        groups = [group for optimiser in optimisers for group in optimiser.param_groups]
        parameters = [parameter for group in groups for parameter in group["params"]]
        start = time.monotonic()
        seconds = args.max_minutes and args.max_minutes * 60 - (start - (started or start)) - SAVING_S
        schedule = Schedule(args.lr, args.steps, warm_up=warm_up, cool_down=cool_down, seconds=seconds)
        steps, unread, since_saved = range(self.first, args.steps), [], []
        for step, batch in zip(steps, batches(steps)):
            for group in groups:
                group["lr"] = schedule.rate_at(step, schedule.progress(step))
            torch.manual_seed(args.seed + step)
            unread.append(gradients(batch))
            torch.nn.utils.clip_grad_norm_(parameters, max_norm)
            for optimiser in optimisers:
                optimiser.step()
            update_average(self.parts["averaged"], self.parts["policy"], step, args.ema)
            done = step + 1
            is_last = schedule.progress(done) >= 1
            is_saved = done % args.save_every == 0 or is_last
            if done % LOG_STEPS == 0 or is_saved:
                since_saved += read(unread, done)
                unread.clear()
            if done % LOG_STEPS == 0:
                rate = (done - self.first) * args.batch_size / (time.monotonic() - start)
                means = ", ".join(f"{name} {x:.4f}" for name, x in self.means(since_saved[-LOG_STEPS:]).items())
                print(f"step {done} of {args.steps}: {means}, {rate:.1f} samples/s", flush=True)
            if is_saved:
                row = {"step": done} | self.means(since_saved) | {"seconds": round(time.monotonic() - start, 1)}
                self.save(row, export, evaluate)
                since_saved.clear()
            if is_last:
                break

    def means(self, losses):
        """Return the mean of each loss that all of these steps have."""
        return {name: sum(values) / len(values) for name, values in zip(self.losses, zip(*losses))}

    def save(self, row, export, evaluate):
        """Write a checkpoint, evaluate it, and write a row of the log and the state."""
        import torch

        if not evaluate:
            export(self.args.output)
        else:
            newest = self.folder / "newest"
            export(newest)
            row |= evaluate(row["step"], newest)
            if row["is_best"]:
                for path in sorted(newest.iterdir()):
                    path.replace(self.args.output / path.name)
        with open(self.folder / "log.jsonl", "a") as log:
            log.write(json.dumps(row) + "\n")
        print(json.dumps(row), flush=True)
        # Saved last: after an interruption, unfinished work since the previous checkpoint is repeated.
        saved = {name: part.state_dict() for name, part in self.parts.items()}
        torch.save(saved | {"step": row["step"], "fixed": self.fixed}, self.folder / "new.pt")
        (self.folder / "new.pt").replace(self.state)


def read(losses, done):
    """Return the losses of the last steps as numbers. It waits for the device, so it is not done in every step."""
    numbers = [values.tolist() for values in losses]
    for step, values in enumerate(numbers, done - len(losses)):
        if not math.isfinite(sum(values)):
            sys.exit(f"the losses of step {step} are {values}; lower --lr and resume from the last checkpoint")
    return numbers


def add_arguments(parser, *, steps, batch_size, lr, frame_stride):
    """Add the options that the training scripts share, with a script's own defaults."""
    parser.add_argument("dataset", type=Path, help="dataset of one morphology, for example demos/single")
    parser.add_argument("-o", "--output", type=Path, required=True, help="checkpoint folder")
    parser.add_argument("--steps", type=int, default=steps, help="total updates; may be increased when resuming")
    parser.add_argument("--max-minutes", type=float, help="time in which to end, even before the last step")
    parser.add_argument(
        "--frame-stride", type=int, default=frame_stride, help="begin examples at every nth frame of an episode"
    )
    parser.add_argument("--batch-size", type=int, default=batch_size, help="observations per update")
    parser.add_argument("--lr", type=float, default=lr, help="learning rate between warm-up and decay")
    parser.add_argument("--ema", type=float, default=0.999, help="decay of the averaged weights, per step")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--init", metavar="CHECKPOINT", help="fine-tune the weights of a checkpoint of this script")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--save-every", type=int, default=1000, help="steps between checkpoints")
    parser.add_argument("--episodes", type=int, default=20, help="episodes per task in an evaluation")
    parser.add_argument("--evaluation-seed", type=int, default=7, help="use another seed for reported results")
