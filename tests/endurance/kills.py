#!/usr/bin/env python3
"""Kill the processes of real runs with SIGKILL, and check that nothing is lost and nothing is left behind.

    kills.py --hypogeum target/release/hypogeum --kills 1000 --output kills.csv
    kills.py --hypogeum target/release/hypogeum --only "sim 17"

Half of the kills come at named phases: after each call by which a process changes what others can see, while it starts
or ends. The others come at random times. README.md in this folder explains what is checked.
"""

import argparse
import csv
import itertools
import random
import statistics
import sys
from collections import Counter
from fnmatch import fnmatchcase
from pathlib import Path

from scenarios import SCENARIOS
from trials import Bench, Kill, Phase, Trial, pattern

# Trials of a phase that is not reached. Which process makes some files depends on which is faster.
MAX_TRIES = 3
# Roles of the processes that are killed at random times. Each group gets a third of the kills.
ROLES = (("orchestrator",), ("sim",), ("host-act", "host-random"))
# Processes that are killed together, and the seconds for which they are stopped before: those of any command,
# and children. HOST is one of a scenario's hosts.
TOGETHER = (("all", 0.0), ("orchestrator", 0.3), ("all", 0.3))
TOGETHER_WITH_CHILDREN = (
    *TOGETHER, ("sim+HOST", 0.0), ("orchestrator+sim", 0.0), ("orchestrator+HOST", 0.0), ("sim", 0.3), ("HOST", 0.3),
)  # fmt: skip
# Share of the random kills that hit all processes of a run at once.
SHARE_OF_ALL = 0.1
PROGRESS_INTERVAL = 25
FIELDS = (
    "kind", "role", "nth", "function", "path", "time_s", "trial", "runs", "last_exit_s", "left_at_once", "trial_s",
    "failure",
)  # fmt: skip


def phases(log: list[list[str]]) -> dict[Phase, int]:
    """Returns the calls of a run that are worth a kill, with their numbers.

    These are the calls until the first finished episode, and those after the last. Locks of the results file are left
    out, since they end with their holder.
    """
    finished = [int(line[0]) for line in log if line[4] == "finished"]
    found = {}
    earlier: dict[tuple[str, str], list[str]] = {}
    for time_ns, role, _, number, function, path in log:
        if function == "finished":
            continue
        paths = earlier.setdefault((role, function), [])
        paths.append(path)
        is_edge = int(time_ns) <= min(finished) or int(time_ns) >= max(finished)
        is_lock = role == "orchestrator" and function.startswith("fcntl")
        if is_edge and not is_lock:
            shape = pattern(path)
            phase = Phase(role, sum(fnmatchcase(other, shape) for other in paths), function, shape)
            found[phase] = int(number)
    return dict(sorted(found.items(), key=lambda item: (item[0].role, item[1])))


def evenly(items: list, n: int) -> list:
    """Returns `n` items at equal distances, or all if there are fewer."""
    return items if n >= len(items) else [items[i * len(items) // n] for i in range(n)]


def random_trial(seed: int, number: int, duration_s: float) -> Trial:
    """Returns a trial with one to three kills at random times. It depends on the arguments only."""
    rng = random.Random(f"{seed} {number}")
    kills = []
    for _ in range(rng.choice([1, 1, 2, 3])):
        role = "all" if rng.random() < SHARE_OF_ALL else rng.choice(rng.choice(ROLES))
        kills.append(Kill(role, time_s=rng.uniform(0.0, duration_s)))
    return Trial(f"random {number}", kills)


def together_trial(seed: int, number: int, durations_s: dict[str, float]) -> Trial:
    """Returns a trial with one or two kills of several processes at once. It depends on the arguments only."""
    rng = random.Random(f"together {seed} {number}")
    name = list(durations_s)[number % len(durations_s)]
    kills = []
    for _ in range(rng.choice([1, 1, 2])):
        hosts = SCENARIOS[name].hosts
        role, stop_s = rng.choice(TOGETHER_WITH_CHILDREN if hosts else TOGETHER)
        role = role.replace("HOST", rng.choice(hosts or ("",)))
        kills.append(Kill(role, time_s=rng.uniform(0.0, durations_s[name]), stop_s=stop_s))
    return Trial(f"together {number} ({name})", kills, SCENARIOS[name])


def kill_together(bench: Bench, args) -> int:
    """Runs trials of every scenario in turn. Returns the exit code."""
    references, durations_s = {}, {}
    names = args.scenarios.split(",") if args.scenarios else list(SCENARIOS)
    for name in names:
        undisturbed = [bench.run(Trial(f"reference of {name}", [], SCENARIOS[name]), None) for _ in range(2)]
        if any(trial.failures for trial in undisturbed) or undisturbed[0].rows != undisturbed[1].rows:
            failures = [failure for trial in undisturbed for failure in trial.failures]
            print(f"undisturbed, {name} failed: " + "\n".join(failures or ["other outcomes"]), file=sys.stderr)
            return 1
        references[name], durations_s[name] = undisturbed[0].rows, min(trial.duration_s for trial in undisturbed)
        print(f"{name}: {durations_s[name]:.2f} s, {len(references[name])} rows", file=sys.stderr)
    record = Record(args.output)
    for number in itertools.count():
        if args.only:
            number = int(args.only.split()[1])
        trial = together_trial(args.seed, number, durations_s)
        record.add(bench.run(trial, references[names[number % len(names)]]))
        if record.n_kills >= args.kills or len(record.trials) >= 2 * args.kills:
            break
    print(record.summary())
    return int(any(trial.failures for trial in record.trials))


class Record:
    """The outcome of all trials so far."""

    def __init__(self, output: Path | None):
        self.trials: list[Trial] = []
        self.n_kills = 0
        self.file = output.open("w", newline="") if output else None
        self.writer = csv.writer(self.file) if self.file else None
        if self.writer:
            self.writer.writerow(FIELDS)

    def add(self, trial: Trial):
        self.trials.append(trial)
        landed = [kill for kill in trial.kills if kill.landed]
        for kill in landed:
            if self.writer:
                self.writer.writerow(self._row(trial, kill))
        if self.file:
            self.file.flush()
        shown = self.n_kills // PROGRESS_INTERVAL
        self.n_kills += len(landed)
        if trial.failures:
            print(f"\nFAILED {trial.name}: " + "\n".join(trial.failures), file=sys.stderr)
        elif self.n_kills // PROGRESS_INTERVAL > shown:
            n_failed = sum(bool(trial.failures) for trial in self.trials)
            print(f"{self.n_kills} kills, {n_failed} trials failed; {trial.name}", file=sys.stderr)

    @staticmethod
    def _row(trial: Trial, kill: Kill) -> list:
        exit_s = "" if kill.last_exit_s is None else f"{kill.last_exit_s:.3f}"
        failure = trial.failures[0].splitlines()[0] if trial.failures else ""
        phase = kill.phase
        call = [kill.kind, kill.role, "", "", "", f"{kill.time_s:.3f}", trial.name]
        if phase is not None:
            call = ["phase", kill.role, phase.nth, phase.function, phase.path, "", ""]
        return [*call, trial.runs, exit_s, len(kill.left_at_once), f"{trial.duration_s:.3f}", failure]

    def summary(self) -> str:
        """Returns a table of kills by role and kind, and what was measured."""
        counts: Counter[tuple[str, str]] = Counter()
        failed: Counter[tuple[str, str]] = Counter()
        exits: dict[tuple[str, str], list[float]] = {}
        for trial in self.trials:
            for kill in (kill for kill in trial.kills if kill.landed):
                key = (kill.role, kill.kind)
                counts[key] += 1
                failed[key] += bool(trial.failures)
                exits.setdefault(key, []).extend([] if kill.last_exit_s is None else [kill.last_exit_s])
        lines = [f"{'role':14}{'kind':10}{'kills':>7}{'failed':>8}{'last exit after, at most':>26}"]
        for role, kind in sorted(counts):
            key = (role, kind)
            longest = f"{max(exits[key]):.2f} s" if exits[key] else "–"
            lines.append(f"{role:14}{kind:10}{counts[key]:7}{failed[key]:8}{longest:>26}")
        missed = [trial.name for trial in self.trials if not any(kill.landed for kill in trial.kills)]
        slowest = max(self.trials, key=lambda trial: trial.duration_s)
        lines += [
            f"{self.n_kills} kills in {len(self.trials)} trials with {sum(trial.runs for trial in self.trials)} runs; "
            f"{sum(bool(trial.failures) for trial in self.trials)} trials failed",
            f"slowest trial: {slowest.duration_s:.1f} s ({slowest.name})",
            f"trials that ended before their kill: {len(missed)}{': ' if missed else ''}{', '.join(missed[:5])}",
        ]
        return "\n".join(lines)


def only(name: str, found: dict[Phase, int], args, duration_s: float) -> Trial:
    """Returns the trial of this name: `random 4`, `sim 17` by the number of a call, or a phase in full."""
    role, number, *call = name.split(" ", 3)
    if role == "random":
        return random_trial(args.seed, int(number), duration_s)
    if call:
        phase = Phase(role, int(number), *call)
    else:
        phase = next(phase for phase in found if phase.role == role and found[phase] == int(number))
    return Trial(str(phase), [Kill(role, phase)], before=args.before)


def planned(args, found: dict[Phase, int], duration_s: float):
    """Yields the trials to run: those at phases first, then random ones without end."""
    while args.only:
        yield only(args.only, found, args, duration_s)
    for phase in evenly(list(found), args.kills // 2):
        for _ in range(MAX_TRIES):
            trial = Trial(str(phase), [Kill(phase.role, phase)], before=args.before)
            yield trial
            if trial.kills[0].landed:
                break
    for number in itertools.count():
        yield random_trial(args.seed, number, duration_s)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hypogeum", type=Path, required=True, help="the program to test")
    parser.add_argument("--kills", type=int, default=1000, help="number of kills (default: 1000)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the random kills (default: 0)")
    parser.add_argument("--only", metavar="TRIAL", help='repeat one trial, such as "sim 17" or "random 4"')
    parser.add_argument("--before", action="store_true", help="kill before the call of a phase instead of after it")
    parser.add_argument(
        "--together", action="store_true", help="kill several processes at once, during every command that starts some"
    )
    parser.add_argument("--scenarios", metavar="LIST", help="the commands of --together (default: all)")
    parser.add_argument("--list", action="store_true", help="list the phases and kill nothing")
    parser.add_argument("--output", type=Path, metavar="FILE.csv", help="file to write, with one line per kill")
    args = parser.parse_args()

    bench = Bench(args.hypogeum.resolve())
    try:
        if args.together:
            return kill_together(bench, args)
        undisturbed = [bench.run(Trial(f"reference {i}", []), None) for i in range(3)]
        for trial in undisturbed:
            if trial.failures or trial.rows != undisturbed[0].rows:
                print("an undisturbed run failed: " + "\n".join(trial.failures or ["other rows"]), file=sys.stderr)
                return 1
        duration_s = statistics.median(trial.duration_s for trial in undisturbed)
        found = phases(undisturbed[0].log)
        print(f"an undisturbed run takes {duration_s:.2f} s and has {len(found)} phases", file=sys.stderr)
        if args.list:
            print("\n".join(f"{phase.role} {number}: {phase}" for phase, number in found.items()))
            return 0
        record = Record(args.output)
        for trial in planned(args, found, duration_s):
            record.add(bench.run(trial, undisturbed[0].rows))
            if record.n_kills >= args.kills or len(record.trials) >= 2 * args.kills:
                break
    finally:
        bench.close()
    print(record.summary())
    return int(any(trial.failures for trial in record.trials))


if __name__ == "__main__":
    sys.exit(main())
