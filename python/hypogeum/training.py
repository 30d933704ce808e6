"""Parts that the training scripts share: the schedule, averaged weights, and closed-loop evaluation."""

import sys
import time

from .evaluation import evaluate
from .program import EvaluationError


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


class CheckpointEvaluation:
    """Evaluation of a training's checkpoints in the simulator, each compared with the one before.

    Args:
        policy: Spec of the policy, for example `act:FOLDER`.
        tasks: Task names.
        options: Further arguments of `hypogeum.evaluate`.
    """

    def __init__(self, policy, tasks, **options):
        self.policy, self.tasks, self.options, self.previous = policy, tasks, options, None

    def __call__(self, step):
        """Return what the log says of the checkpoint of a step; exits with the program's message if that fails.

        This is `success_once` per task and, from the second checkpoint on, the verdict `than_before`.
        """
        try:
            results = evaluate(self.policy, self.tasks, name=f"step-{step}", quiet=True, **self.options)
            row = {"success_once": {cell.task: cell.rate for cell in results.cells}}
            if self.previous is not None:
                comparison = results.compare(self.previous)
                row["than_before"] = comparison.verdict
                print(comparison, flush=True)
        except EvaluationError as error:
            sys.exit(f"error: {error}")
        self.previous = results
        return row
