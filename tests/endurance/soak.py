#!/usr/bin/env python3
"""Watch one long run from outside, and check that nothing grows with time.

    soak.py --hypogeum target/release/hypogeum --hours 8 --output soak
    soak.py --hypogeum target/release/hypogeum --hours 1 --kill-every 20

The output folder receives samples.csv and curves.svg. The exit code is 1 if something grows beyond its bound, or if the
run does not end in order when it is interrupted. README.md in this folder explains what is measured.
"""

import argparse
import csv
import os
import random
import re
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import processes
from figure import Panel, draw

CHECKPOINT = Path(__file__).resolve().parent.parent.parent / "policy-host" / "tests" / "data" / "act-tiny"
ROLES = ("orchestrator", "sim", "host-act", "host-random", "host-idle")
MEMORY_KINDS = {"anon": "RssAnon", "file": "RssFile", "shmem": "RssShmem"}
# Cells of the run: 4 policies, 28 tasks, and the perturbations that apply to each.
N_CELLS = 4 * 450
# More episodes than a core finishes in a second, so that the run does not end by itself.
EPISODES_PER_CORE_SECOND = 40
# Start-up of the run, which is not sampled, and time for its end after the interruption.
START_TIMEOUT_S, END_TIMEOUT_S = 60.0, 30.0
# A line is fitted through the samples after this share of the time. Before it, caches fill.
SETTLING = 1 / 3
# Growth of memory that fails: both bounds must be exceeded, so that noise of a short run does not.
MEMORY_MIB_PER_HOUR, MEMORY_MIB = 8.0, 4.0
# A heap wanders by tens of MiB with the episodes in progress, so a shorter run cannot tell whether it grows.
MEMORY_HOURS = 1.0
# Growth of a count that fails: the fitted line rises by this much.
COUNT_RISE = 1.0
MIB = 1 << 20
EXIT_INTERRUPTED = 130


class Run:
    """The run and its traces."""

    def __init__(self, program: Path, folder: Path, n_episodes: int):
        self.folder, self.base = folder, folder / "hypogeum"
        self.db, self.stderr = folder / "soak.db", folder / "stderr"
        self.token = f"soak-{os.getpid()}"
        words = ["run", "--policy", "expert", "--policy", "random", "--policy", f"act=act:{CHECKPOINT}"]
        words += ["--policy", "idle", "--tasks", "all", "--perturbations", "all", "--episodes", str(n_episodes)]
        words += ["--renderer", "cpu", "--db", str(self.db)]
        env = {**os.environ, "XDG_RUNTIME_DIR": str(folder), processes.TOKEN: self.token}
        with self.stderr.open("w") as stderr:
            self.process = subprocess.Popen(
                [program, *words], env=env, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=stderr
            )

    def prefixes(self) -> set[str]:
        """Returns the starts of the names of the run's segments."""
        return {f"hyp_{os.getuid()}_{path.name}_" for path in self.base.glob("*")}

    def n_episodes(self) -> int:
        """Returns the number of finished episodes that the run has reported last."""
        reports = re.findall(r"(\d+)/\d+ episodes", self.stderr.read_text(errors="replace"))
        return int(reports[-1]) if reports else 0

    def sample(self, time_s: float) -> dict[str, float]:
        """Returns the values of all columns of samples.csv that can be read now."""
        row: dict[str, float] = {"time_s": round(time_s, 1), "episodes": self.n_episodes()}
        sizes = [size for path in processes.segments(self.prefixes()) if (size := _bytes(path)) is not None]
        row |= {"segments": len(sizes), "segments_mib": sum(sizes) / MIB}
        results = [self.db, self.db.with_name(self.db.name + "-wal")]
        row["results_mib"] = sum(_bytes(path) or 0 for path in results) / MIB
        for pid, role in processes.members(self.token).items():
            fields = processes.status(pid)
            if "Threads" in fields:
                for kind, key in MEMORY_KINDS.items():
                    row[f"{role}_{kind}_mib"] = int(fields[key].split()[0]) / 1024
                row[f"{role}_threads"] = int(fields["Threads"])
                row[f"{role}_fds"] = _n_entries(Path(f"/proc/{pid}/fd"))
        return {key: round(value, 2) for key, value in row.items()}

    def kill_child(self, rng: random.Random) -> str:
        """Kills a child and returns its role."""
        children = sorted((role, pid) for pid, role in processes.members(self.token).items() if role != "orchestrator")
        if not children:
            return ""
        role, pid = rng.choice(children)
        return role if processes.kill(pid) else ""

    def interrupt(self) -> list[str]:
        """Ends the run with SIGINT and returns what was not in order."""
        problems = []
        prefixes = self.prefixes()
        self.process.send_signal(signal.SIGINT)
        try:
            code = self.process.wait(END_TIMEOUT_S)
            if code != EXIT_INTERRUPTED:
                problems.append(f"the interrupted run ended with exit code {code}, expected {EXIT_INTERRUPTED}")
        except subprocess.TimeoutExpired:
            described = "\n".join(map(processes.describe, processes.members(self.token)))
            problems.append(f"the run goes on {END_TIMEOUT_S:.0f} s after its interruption:\n{described}")
        left = [str(path) for path in [*processes.segments(prefixes), *self.base.glob("*")]]
        left += [path.name for path in self.folder.glob(f"{self.db.name}-*")]
        alive = processes.members(self.token)
        if left or alive:
            problems.append(f"left behind: {left[:5]}, processes {alive}")
        n_reported = self.n_episodes()
        with sqlite3.connect(f"file:{self.db}?mode=ro", uri=True) as connection:
            (n_rows,) = connection.execute("SELECT count(*) FROM episodes").fetchone()
            (n_errors,) = connection.execute("SELECT count(*) FROM episodes WHERE error IS NOT NULL").fetchone()
            (damage,) = connection.execute("PRAGMA integrity_check(1)").fetchone()
        connection.close()
        print(f"{n_rows} episodes stored, {n_errors} of them with an error")
        if damage != "ok" or n_rows < n_reported or n_errors:
            problems.append(f"results: {damage}, {n_rows} rows of {n_reported} reported, {n_errors} errors")
        return problems

    def stop(self):
        """Kills what is still alive and removes its traces."""
        prefixes = self.prefixes()
        for pid in processes.members(self.token):
            processes.kill(pid)
        self.process.wait()
        for path in processes.segments(prefixes):
            path.unlink(missing_ok=True)


@dataclass
class Growth:
    """The line through a curve."""

    column: str
    first: float
    """Value of the line at the first of its samples."""
    per_hour: float
    rise: float
    """Difference of the line's values at the last and the first of its samples."""

    def is_leak(self) -> bool:
        if self.column.endswith("_mib"):
            return self.per_hour > MEMORY_MIB_PER_HOUR and self.rise > MEMORY_MIB
        return self.rise >= COUNT_RISE


def fit(samples: list[dict[str, float]], column: str, from_s: float) -> Growth | None:
    """Returns the least-squares line through the samples of a column from `from_s` on."""
    points = [(row["time_s"], row[column]) for row in samples if column in row and row["time_s"] >= from_s]
    if len(points) < 3:
        return None
    n = len(points)
    mean_x, mean_y = sum(x for x, _ in points) / n, sum(y for _, y in points) / n
    slope = sum((x - mean_x) * (y - mean_y) for x, y in points) / sum((x - mean_x) ** 2 for x, _ in points)
    first = mean_y + slope * (points[0][0] - mean_x)
    return Growth(column, first, slope * 3600, slope * (points[-1][0] - points[0][0]))


def columns() -> list[str]:
    """Returns the columns of samples.csv."""
    kinds = [*(f"{kind}_mib" for kind in MEMORY_KINDS), "fds", "threads"]
    by_role = [f"{role}_{kind}" for role in ROLES for kind in kinds]
    return ["time_s", "episodes", "segments", "segments_mib", "results_mib", *by_role]


def judged(with_kills: bool, hours: float) -> list[str]:
    """Returns the columns that must not grow. Where children are killed, their memory starts anew each time."""
    expected = [column for column in columns() if column not in ("time_s", "episodes", "results_mib")]
    is_restarted = [f"{role}_" for role in ROLES if role != "orchestrator"] if with_kills else []
    is_short = hours < MEMORY_HOURS

    def is_judged(name):
        is_own = name.endswith("_mib") and not name.startswith("segments")
        return not (is_own and (is_short or name.startswith(tuple(is_restarted))))

    return [name for name in expected if is_judged(name)]


def panels(samples: list[dict[str, float]]) -> list[Panel]:
    """Returns the charts of the figure."""

    def curve(*names):
        return [(row["time_s"], sum(row[name] for name in names)) for row in samples if all(name in row for name in names)]

    own = {role: curve(f"{role}_anon_mib", f"{role}_file_mib") for role in ROLES}
    shared = {"in use by the sim": curve("sim_shmem_mib"), "all segments": curve("segments_mib")}
    return [
        Panel("memory per process without shared memory (MiB)", own),
        Panel("open file descriptors per process", {role: curve(f"{role}_fds") for role in ROLES}),
        Panel("threads per process", {role: curve(f"{role}_threads") for role in ROLES}),
        Panel("shared memory (MiB)", shared),
        Panel("finished episodes (thousands)", {"episodes": [(t, n / 1000) for t, n in curve("episodes")]}),
    ]


def _bytes(path: Path) -> int | None:
    """Returns the size of a file in bytes as stored, or nothing if it is gone."""
    try:
        return path.stat().st_blocks * 512
    except FileNotFoundError:
        return None


def _n_entries(folder: Path) -> int:
    try:
        return len(os.listdir(folder))
    except FileNotFoundError:
        return 0


def watch(run: Run, args, output: Path) -> tuple[list[dict[str, float]], list[float], list[str]]:
    """Samples the run until its time is over. Returns the samples, the times of the kills, and problems."""
    samples, kills_s, rng = [], [], random.Random(args.seed)
    start = time.monotonic()
    next_sample, next_kill = 0.0, args.kill_every or float("inf")
    with (output / "samples.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, columns(), restval="")
        writer.writeheader()
        while (now := time.monotonic() - start) < 3600 * args.hours:
            if run.process.poll() is not None:
                tail = "\n".join(run.stderr.read_text(errors="replace").splitlines()[-20:])
                return samples, kills_s, [f"the run ended by itself with exit code {run.process.returncode}:\n{tail}"]
            if now >= next_sample:
                samples.append(run.sample(now))
                writer.writerow(samples[-1])
                file.flush()
                next_sample = now + args.interval
            if now >= next_kill and run.kill_child(rng):
                kills_s.append(now)
                next_kill = now + args.kill_every
            time.sleep(0.1)
    return samples, kills_s, []


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hypogeum", type=Path, required=True, help="the program to test")
    parser.add_argument("--hours", type=float, default=8.0, help="duration (default: 8)")
    parser.add_argument("--output", type=Path, default=Path("soak"), help="folder to write (default: soak)")
    parser.add_argument("--interval", type=float, default=5.0, help="seconds between samples (default: 5)")
    parser.add_argument("--kill-every", type=float, metavar="SECONDS", help="kill a random child this often")
    parser.add_argument("--seed", type=int, default=0, help="seed of the choice of children to kill (default: 0)")
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)

    cores = len(os.sched_getaffinity(0))
    n_episodes = round(3600 * args.hours * cores * EPISODES_PER_CORE_SECOND / N_CELLS) + 10
    with tempfile.TemporaryDirectory(prefix="h") as folder:
        run = Run(args.hypogeum.resolve(), Path(folder), n_episodes)
        try:
            samples, kills_s, problems = watch(run, args, args.output)
            problems += run.interrupt() if run.process.poll() is None else []
        finally:
            run.stop()
    if not samples:
        print("\n".join(problems))
        return 1
    end_s = samples[-1]["time_s"]
    (args.output / "curves.svg").write_text(draw(panels(samples), max(end_s, 1.0), kills_s))

    print(f"{end_s / 3600:.2f} h, {len(samples)} samples, {samples[-1]['episodes']:.0f} episodes, {len(kills_s)} kills")
    print(f"{'column':26}{'level':>10}{'per hour':>12}  judgement")
    must_not_grow = judged(bool(args.kill_every), end_s / 3600)
    for column in columns()[1:]:
        growth = fit(samples, column, SETTLING * end_s)
        if growth is None:
            problems.append(f"{column} has too few samples")
            continue
        leaks = column in must_not_grow and growth.is_leak()
        verdict = "grows" if leaks else "steady" if column in must_not_grow else "not judged"
        print(f"{column:26}{growth.first:10.1f}{growth.per_hour:+12.2f}  {verdict}")
        if leaks:
            problems.append(f"{column} grows by {growth.per_hour:.2f} per hour, {growth.rise:.2f} while it was watched")
    print("\n".join(f"FAILED: {problem}" for problem in problems) or "nothing grows, and the run ended in order")
    return int(bool(problems))


if __name__ == "__main__":
    sys.exit(main())
