"""Trials: one command under some kills, repeated until it is complete, with everything about it checked.

This module runs and checks; kills.py decides which processes are killed and when. README.md lists the checks.
"""

import os
import random
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import processes
from scenarios import HOST, RUN, Scenario

HERE = Path(__file__).resolve().parent
# Time limit of a run, and of the exit of all children after the orchestrator was killed.
RUN_TIMEOUT_S = 60.0
EXIT_TIMEOUT_S = 5.0
POLL_INTERVAL_S = 0.001
# Runs of one command: each kill of the orchestrator needs another.
MAX_ATTEMPTS = 8
# The orchestrator gives up a child that fails or is ended this often without a finished episode, and says so.
FAILURE_LIMIT = 3
GIVEN_UP = re.compile(r"failed \d+ times without finishing an episode|was ended \d+ times from outside")
# Longest time between the kills of processes that are killed together.
TOGETHER_S = 0.001
# Exit code of a process that SIGKILL has ended, as subprocess reports it.
KILLED = -9
# Functions that give a file its name.
CREATING = ("open", "open64", "openat", "openat64", "creat", "shm_open", "mkdir", "mkdirat", "bind", "link", "linkat")


@dataclass(frozen=True, order=True)
class Phase:
    """A call by which a process of a run changes what others can see."""

    role: str
    nth: int
    """Which of the calls with the same function and path, counted from 1."""
    function: str
    path: str
    """A pattern: random parts are replaced by `*`."""

    def __str__(self) -> str:
        return f"{self.role} {self.nth} {self.function} {self.path}"


@dataclass
class Kill:
    """A kill that is planned, and what came of it."""

    role: str
    """`orchestrator`, `sim`, `host-NAME`, several of them joined by `+`, or `all`."""
    phase: Phase | None = None
    """The call at which it comes, or none if it comes at a random time."""
    time_s: float = 0.0
    """Time since the start of the run at which it comes otherwise."""
    stop_s: float = 0.0
    """Time for which the victims are stopped before they are killed."""
    landed: bool = False
    last_exit_s: float | None = None
    """Time from the end of the orchestrator to that of the last child."""
    left_at_once: list[str] = field(default_factory=list)
    """Files that were left when the last child had exited."""

    @property
    def kind(self) -> str:
        """`phase`, `together` or `random`."""
        return "phase" if self.phase else "together" if self.stop_s or "+" in self.role else "random"


@dataclass
class Trial:
    """One command under some kills, repeated until it is complete."""

    name: str
    kills: list[Kill]
    scenario: Scenario = RUN
    before: bool = False
    runs: int = 0
    duration_s: float = 0.0
    failures: list[str] = field(default_factory=list)
    log: list[list[str]] = field(default_factory=list)
    """Lines of the log of calls: time in ns, role, pid, number, function, path."""
    rows: list[tuple] = field(default_factory=list)
    """The outcome of the scenario: rows of a results file, or what stands for them."""


class Bench:
    """A folder in which one command runs at a time, watched from outside."""

    def __init__(self, program: Path):
        self.program = program
        self.folder = Path(tempfile.mkdtemp(prefix="h"))
        self.base = self.folder / "hypogeum"
        self.work, self.tmp = self.folder / "work", self.folder / "tmp"
        self.log, self.mark, self.stderr = (self.folder / name for name in ("calls", "mark", "stderr"))
        self.shim = self.folder / "syscalls.so"
        flags = ["-std=c11", "-O1", "-Wall", "-shared", "-fPIC"]
        subprocess.run(["cc", *flags, "-o", self.shim, HERE / "syscalls.c", "-ldl"], check=True)
        self.results = self.folder / "r.db"
        self.host: subprocess.Popen | None = None
        self.n_trials = 0
        self.known: dict[int, tuple[str, str | None]] = {}

    def close(self):
        shutil.rmtree(self.folder, ignore_errors=True)

    def run(self, trial: Trial, reference: list[tuple] | None) -> Trial:
        """Runs the command under the trial's kills until it is complete, and checks everything about it."""
        self.n_trials += 1
        token = f"{os.getpid()}-{self.n_trials}"
        self.known = {}
        for folder in (self.work, self.tmp):
            folder.mkdir()
        self._prepare(trial.scenario)
        start = time.monotonic()
        try:
            self._repeat(trial, token)
            self._end_host()
            trial.duration_s = time.monotonic() - start
            self._check_end(trial, token, reference)
        finally:
            trial.log = self._calls()
            if trial.failures:
                trial.failures.append(self._evidence(trial))
            self._clean(token)
        return trial

    def _prepare(self, scenario: Scenario):
        """Provides what the command of a scenario reads, made once."""
        if scenario.before and not self.results.exists():
            env = {**os.environ, "XDG_RUNTIME_DIR": str(self.folder)}
            subprocess.run([self.program, *scenario.before], cwd=self.folder, env=env, check=True, capture_output=True)
        if scenario.before:
            shutil.copy(self.results, self.work)

    def _serve(self, scenario: Scenario, token: str):
        """Starts the host in Python of a scenario, unless it is running."""
        if scenario.has_host and (self.host is None or self.host.poll() is not None):
            env = {**os.environ, "XDG_RUNTIME_DIR": str(self.folder), processes.TOKEN: token}
            quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            self.host = subprocess.Popen([sys.executable, "-c", HOST], cwd=self.tmp, env=env, **quiet)

    def _end_host(self):
        if self.host is not None:
            self.host.send_signal(signal.SIGINT)
            try:
                self.host.wait(EXIT_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self.host.kill()
                self.host.wait()
            self.host = None

    def _repeat(self, trial: Trial, token: str):
        due = sorted((kill for kill in trial.kills if kill.phase is None), key=lambda kill: kill.time_s)
        while trial.runs < MAX_ATTEMPTS:
            trial.runs += 1
            code, n_landed = self._attempt(trial, token, due)
            if code == 0:
                return
            said = self.stderr.read_text(errors="replace")
            given_up = code in (2, 3) and GIVEN_UP.search(said) and n_landed >= FAILURE_LIMIT
            # After a failure, the command is repeated all the same, to tell if that helps.
            if code != KILLED and not given_up:
                trial.failures.append(f"run {trial.runs} ended with exit code {code}")
        trial.failures.append(f"not complete after {MAX_ATTEMPTS} runs")

    def _attempt(self, trial: Trial, token: str, due: list[Kill]) -> tuple[int, int]:
        """Runs the command once. Returns its exit code and the number of kills that hit a child."""
        earlier = self._leftovers()
        with self.stderr.open("a") as stderr:
            start = time.monotonic()
            process = subprocess.Popen(
                [self.program, *trial.scenario.words], cwd=self.work, env=self._environment(trial, token), stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL, stderr=stderr,
            )  # fmt: skip
        n_landed = 0
        fatal = None
        while process.poll() is None:
            self._serve(trial.scenario, token)
            elapsed = time.monotonic() - start
            if elapsed > RUN_TIMEOUT_S:
                self._report_hang(trial, token, f"no end after {RUN_TIMEOUT_S:.0f} s")
                return process.wait(), n_landed
            if due and elapsed >= due[0].time_s and self._strike(due[0], process.pid, token):
                kill = due.pop(0)
                kill.time_s = elapsed
                if {"orchestrator", "all"} & set(kill.role.split("+")):
                    fatal = kill
                    break
                n_landed += kill.role.count("+") + 1
            time.sleep(POLL_INTERVAL_S)
        code = process.wait()
        ended = time.monotonic()
        if fatal is None and self.mark.exists() and code == KILLED:
            fatal = trial.kills[0]
        for kill in trial.kills:
            if kill.phase is not None and not kill.landed and self.mark.exists():
                kill.landed = True
        if fatal is not None and code == KILLED:
            self._check_orphans(trial, fatal, token, ended, earlier)
        return code, n_landed

    def _strike(self, kill: Kill, orchestrator: int, token: str) -> bool:
        """Kills the processes that a random kill is meant for. Returns `False` if one of them does not exist now."""
        wanted = set(kill.role.split("+"))
        # A child that does not execute its program yet still looks like its parent.
        alive = {pid: role for pid, role in self._alive(token).items() if role != "orchestrator"} | {
            orchestrator: "orchestrator"
        }
        victims = [pid for pid, role in alive.items() if role in wanted or ("all" in wanted and role != "host-python")]
        if "all" not in wanted and not wanted <= {alive[pid] for pid in victims}:
            return False
        if kill.stop_s > 0.0:
            for pid in victims:
                processes.stop(pid)
            time.sleep(kill.stop_s)
        for pid in victims:
            kill.landed |= processes.kill(pid)
            time.sleep(random.uniform(0.0, TOGETHER_S) / len(victims))
        return kill.landed

    def _check_orphans(self, trial: Trial, kill: Kill, token: str, ended: float, earlier: list[str]):
        """Waits for the children of a killed orchestrator to exit, and looks for what they leave."""

        def children() -> list[int]:
            return [pid for pid, role in self._alive(token).items() if role != "host-python"]

        had_children = bool(children())
        while children():
            if time.monotonic() - ended > EXIT_TIMEOUT_S:
                self._report_hang(trial, token, f"children alive {EXIT_TIMEOUT_S:.0f} s after the orchestrator's end")
                break
            time.sleep(POLL_INTERVAL_S)
        kill.last_exit_s = time.monotonic() - ended if had_children else 0.0
        kill.left_at_once = self._leftovers()
        # If nobody has survived to clean up, the next run does it.
        new = sorted(set(kill.left_at_once) - set(earlier))
        is_alone = kill.role == "orchestrator" and not trial.scenario.has_host
        if had_children and is_alone and new:
            trial.failures.append(f"the children left {', '.join(new[:4])}")

    def _check_end(self, trial: Trial, token: str, reference: list[tuple] | None):
        alive = self._alive(token)
        if alive:
            trial.failures.append(f"alive after the end: {alive}")
        left = self._leftovers()
        left += [str(path) for path in self.tmp.iterdir()]
        left += [path.name for path in self.work.iterdir() if path.name not in trial.scenario.keeps]
        if left:
            effect = self._later_run(token)
            trial.failures.append(f"left {len(left)} files behind, {effect}: {', '.join(map(pattern, left[:4]))}")
        if trial.failures and trial.runs == MAX_ATTEMPTS:
            return
        try:
            trial.rows = trial.scenario.outcome(self.work)
        except (OSError, ValueError, sqlite3.Error) as error:
            trial.failures.append(f"no outcome: {error}")
        if not trial.rows or (reference is not None and trial.rows != reference):
            different = len(set(trial.rows) ^ set(reference or []))
            trial.failures.append(f"{len(trial.rows)} rows, {different} of them differ from the reference")

    def _alive(self, token: str) -> dict[int, str]:
        """Returns the roles of the run's processes by pid, including those that are about to exit."""
        for pid, role in processes.members(token).items():
            self.known[pid] = (role, processes.started(pid))
        # Another process may have got the number of one that has exited.
        return {pid: role for pid, (role, start) in self.known.items() if start and processes.started(pid) == start}

    def _leftovers(self) -> list[str]:
        """Returns the run's files outside its results: segments, folders, and whatever else it has created."""
        calls = self._calls()
        created = {self.work / path for *_, function, path in calls if function in CREATING}
        tags = {f"hyp_{os.getuid()}_{path.name}_" for path in self.base.glob("*")}
        prefixes = {prefix for *_, path in calls for prefix in processes.PREFIX.findall(path)} | tags
        own = {path for path in created if path.exists() and self.work not in path.parents and path != self.base}
        return sorted(map(str, {*own, *processes.segments(prefixes), *self.base.glob("*")}))

    def _later_run(self, token: str) -> str:
        """Starts a run of another results file, and tells its effect on what earlier ones have left."""
        words = ["run", "--policy", "idle", "--tasks", "RaiseCube", "--episodes", "1", "--db", str(self.tmp / "other.db")]
        env = {**os.environ, "XDG_RUNTIME_DIR": str(self.folder), processes.TOKEN: token}
        quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        subprocess.run([self.program, *words], env=env, timeout=RUN_TIMEOUT_S, check=True, **quiet)
        left = self._leftovers()
        return f"of which a later run leaves {len(left)}" if left else "which a later run removes"

    def _calls(self) -> list[list[str]]:
        if not self.log.exists():
            return []
        lines = (line.split("\t") for line in self.log.read_text(errors="replace").splitlines())
        return [line for line in lines if len(line) == 6]

    def _report_hang(self, trial: Trial, token: str, text: str):
        """Records what each process is doing, then kills it."""
        alive = self._alive(token)
        trial.failures.append("\n".join([text, *map(processes.describe, alive)]))
        for pid in alive:
            processes.kill(pid)
        while self._alive(token):
            time.sleep(POLL_INTERVAL_S)

    def _evidence(self, trial: Trial) -> str:
        """Returns the end of the log of a failed trial and the last calls of each of its processes."""
        lines = ["stderr:", *self.stderr.read_text(errors="replace").splitlines()[-20:]]
        by_process: dict[tuple[str, str], list[str]] = {}
        for _, role, pid, number, function, path in trial.log:
            by_process.setdefault((role, pid), []).append(f"{number} {function} {pattern(path)}")
        for (role, pid), calls in by_process.items():
            lines.append(f"last calls of {role}, pid {pid}: {'; '.join(calls[-3:])}")
        return "\n".join(lines)

    def _clean(self, token: str):
        """Removes everything that a trial may have left, so that the next one starts afresh."""
        self._end_host()
        for pid in self._alive(token):
            processes.kill(pid)
        while self._alive(token):
            time.sleep(POLL_INTERVAL_S)
        for path in map(Path, self._leftovers()):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        for folder in (self.work, self.tmp, self.base):
            shutil.rmtree(folder, ignore_errors=True)
        for path in (self.log, self.mark, self.stderr):
            path.unlink(missing_ok=True)

    def _environment(self, trial: Trial, token: str) -> dict[str, str]:
        env = {**os.environ, "XDG_RUNTIME_DIR": str(self.folder), "TMPDIR": str(self.tmp), processes.TOKEN: token}
        env |= {"LD_PRELOAD": str(self.shim), "ENDURANCE_LOG": str(self.log)}
        for kill in trial.kills:
            if kill.phase is not None:
                env |= {"ENDURANCE_ROLE": kill.role, "ENDURANCE_CALL": kill.phase.function}
                env |= {"ENDURANCE_PATH": kill.phase.path, "ENDURANCE_NTH": str(kill.phase.nth)}
                env |= {"ENDURANCE_MARK": str(self.mark)} | ({"ENDURANCE_BEFORE": "1"} if trial.before else {})
        return env


def pattern(path: str) -> str:
    """Returns a pattern for a path in which `*` stands for its random parts."""
    path = re.sub(r"hyp_\d+_[0-9a-f]{12}_", "hyp_*_", path)
    # The hash of a service's or a segment's name is always the same; four digits tell them apart.
    path = re.sub(r"[0-9a-f]{40}", lambda digits: digits[0][:4] + "*", path)
    path = re.sub(r"\d{13,}|\d+(?=_\d+\.part)", "*", path)
    path = re.sub(r"(?<=/)[0-9a-f]{12}(?=/|$)", "*", path)
    return re.sub(r"^.*/(hypogeum|work)/", "*/", path)
