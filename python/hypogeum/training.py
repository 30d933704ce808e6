"""Parts that the training scripts share: the schedule, averaged weights, and closed-loop evaluation."""

import json
import subprocess
import sys
import tempfile
import time


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


def success_rates(binary, policy, tasks, *, episodes, seed, threads, execute):
    """Evaluate a policy in the simulator and return {task: success_once}. Exits with the program's message if it fails.

    Args:
        binary: Path of the `hypogeum` binary.
        policy: Policy as the command line takes it, for example `act:FOLDER`.
        tasks: Task names.
        episodes: Episodes per task.
        seed: Suite seed.
        threads: Worker threads.
        execute: Rows of each action chunk to execute.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = [
            binary, "run", "--policy", f"trained={policy}", "--tasks", ",".join(tasks), "--json", "--quiet",
            "--episodes", str(episodes), "--seed", str(seed), "--db", f"{folder}/results.db",
            "--threads", str(threads), "--execute", str(execute),
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}\n{done.stderr}")
    return {cell["task"]: cell["success_once"] for cell in json.loads(done.stdout)["cells"]}
