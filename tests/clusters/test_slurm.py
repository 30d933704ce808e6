"""Sweeps on a virtual Slurm cluster: preempted, killed, drained, and over their time limit."""

import json
import re
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import slurm
from slurm import SlurmCluster
from sweep import OPTIONS, Rows, Sweep, assert_equal
from waiting import send, wait_for

pytestmark = pytest.mark.skipif(slurm.why_not() is not None, reason=slurm.why_not() or "")

N_SHARDS = 8
# Episodes per cell, so that a shard takes some seconds on one core.
N_EPISODES = 40
# Longest time of a sweep on a busy machine.
SWEEP_S = 150.0
STEP_S = 30.0
# Time in which the controller learns that a script has ended.
SETTLE_S = 1.0
# Time of a task in which episodes finish.
RUN_S = 4.0
OPTIONS_OF_SBATCH = "-p low --cpus-per-task=1"


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Rows:
    """Rows of an undisturbed run on this machine."""
    return Sweep(tmp_path_factory.mktemp("expected"), N_EPISODES).run()


@pytest.fixture
def cluster() -> Iterator[SlurmCluster]:
    with SlurmCluster() as running:
        yield running


def submit(cluster: SlurmCluster, sweep: Sweep, *options: str) -> tuple[str, str]:
    """Submits the sweep, and returns the ids of the array and of the merge."""
    submission = ["submit", "slurm", "sweep.toml", *options, "--", *OPTIONS]
    output = sweep.hypogeum(*submission, env=cluster.environment)
    array, merge = re.findall(r"^(\d+): ", output, re.MULTILINE)
    return array, merge


def state_of(sweep: Sweep, shard: int, n_shards: int = N_SHARDS) -> dict[str, object]:
    """Returns the state of a shard, empty before its first task has begun."""
    try:
        state: dict[str, object] = json.loads((sweep.shards / f"shard-{shard}-of-{n_shards}.json").read_text())
    except FileNotFoundError:
        return {}
    return state


def orchestrator(sweep: Sweep, shard: int, n_shards: int = N_SHARDS) -> int:
    """Waits until a shard is being run, and returns its process."""

    def pid() -> int:
        state = state_of(sweep, shard, n_shards)
        return int(str(state["pid"])) if state.get("phase") == "running" else 0

    return wait_for(f"shard {shard} to begin", pid, STEP_S)


def start_again(cluster: SlurmCluster, task: str) -> None:
    """Removes the two minutes that Slurm waits before it starts a task again."""
    wait_for(f"task {task} to be queued", lambda: cluster.state(task) in ("PENDING", "RUNNING"), STEP_S)
    # Without that pause, the end of the earlier script would be taken for that of the next one.
    job = cluster.jobs()[task]["JobId"]
    wait_for(f"the earlier script of {task} to end", lambda: not cluster.task_processes(job), STEP_S)
    time.sleep(SETTLE_S)
    if cluster.state(task) == "PENDING":
        cluster.command("scontrol", "update", f"JobId={task}", "StartTime=now")


def node_of(cluster: SlurmCluster, task: str) -> str:
    """Waits until a task runs, and returns its node."""
    wait_for(f"task {task} to run", lambda: cluster.state(task) == "RUNNING", STEP_S)
    return cluster.jobs()[task]["NodeList"]


def restarts(cluster: SlurmCluster, task: str) -> int:
    """Returns how often a task was started again."""
    return int(cluster.jobs()[task]["Restarts"])


def preempt(cluster: SlurmCluster, task: str) -> None:
    """Takes the node of a task away by a job of the other partition."""
    node = node_of(cluster, task)
    high = ["-p", "high", "-w", node, "--exclusive", "--output=/dev/null", "--wrap=sleep 1"]
    job = cluster.command("sbatch", "--parsable", *high).strip()
    wait_for(f"{task} to be preempted", lambda: restarts(cluster, task) == 1, STEP_S)
    wait_for("the job that preempts it", lambda: cluster.state(job) == "COMPLETED", STEP_S)
    start_again(cluster, task)


def kill(cluster: SlurmCluster, sweep: Sweep, shard: int, task: str) -> None:
    """Kills the orchestrator of a task, and queues the task again."""
    send(orchestrator(sweep, shard), signal.SIGKILL)
    wait_for(f"{task} to fail", lambda: cluster.state(task) in ("FAILED", "COMPLETING", "PENDING"), STEP_S)
    cluster.command("scontrol", "requeue", task)
    start_again(cluster, task)


def drain(cluster: SlurmCluster, task: str) -> None:
    """Drains the node of a task, which goes on elsewhere, and resumes the node."""
    node = node_of(cluster, task)
    cluster.command("scontrol", "update", f"NodeName={node}", "State=drain", "Reason=test")
    cluster.command("scontrol", "requeue", task)
    start_again(cluster, task)
    assert node_of(cluster, task) != node
    cluster.command("scontrol", "update", f"NodeName={node}", "State=resume")


def wait_for_merge(cluster: SlurmCluster, sweep: Sweep, merge: str) -> str:
    """Waits until the merge has ended, and returns its output."""
    ended = ("COMPLETED", "FAILED", "CANCELLED", "TIMEOUT")
    state = wait_for("the merge", lambda: next((s for s in ended if s == cluster.state(merge)), None), SWEEP_S)
    logs = {path.name: path.read_text() for path in sorted(sweep.shards.glob("*.log"))}
    assert state == "COMPLETED", logs
    return next(text for name, text in logs.items() if "merge" in name)


def test_disturbed_array_equals_one_run(cluster: SlurmCluster, expected: Rows, tmp_path: Path) -> None:
    sweep = Sweep(tmp_path, N_EPISODES)
    array, merge = submit(cluster, sweep, "--shards", "8", "--sbatch", OPTIONS_OF_SBATCH, "--audit", "5%")

    # Four tasks run at a time.
    kill(cluster, sweep, 2, f"{array}_2")
    preempt(cluster, f"{array}_3")
    drain(cluster, f"{array}_6")

    output = wait_for_merge(cluster, sweep, merge)
    audit = re.search(r"(\d+) of (\d+) audited episodes were run by two tasks and agree in every column", output)
    assert audit and audit[1] == audit[2] != "0", output
    assert_equal(sweep.rows(), expected)
    status = json.loads(sweep.hypogeum("status", "results.shards", "--json"))
    assert status["phases"]["finished"] == status["shards"] == N_SHARDS
    wait_for("the last process to end", lambda: not cluster.task_processes(), STEP_S)


def test_task_continues_after_its_time_limit(cluster: SlurmCluster, expected: Rows, tmp_path: Path) -> None:
    sweep = Sweep(tmp_path, N_EPISODES)
    array, merge = submit(cluster, sweep, "--shards", "1", "--sbatch", OPTIONS_OF_SBATCH)
    task = f"{array}_0"
    orchestrator(sweep, 0, n_shards=1)
    time.sleep(RUN_S)
    # Slurm sends it at --signal=B:USR1@SECONDS; limits are whole minutes.
    cluster.command("scancel", "--batch", "--signal=USR1", task)
    wait_for("the task to queue itself again", lambda: restarts(cluster, task) == 1, STEP_S)
    state = state_of(sweep, 0, n_shards=1)
    assert state["phase"] == "interrupted" and 0 < int(str(state["done"])) < sweep.n_episodes, state
    start_again(cluster, task)
    wait_for_merge(cluster, sweep, merge)
    assert_equal(sweep.rows(), expected)
