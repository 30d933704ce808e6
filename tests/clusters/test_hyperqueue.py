"""Shards as tasks of HyperQueue, by its own server and two workers of one core each."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from sweep import OPTIONS, PROGRAM, Rows, Sweep, assert_equal

hyperqueue = pytest.importorskip("hyperqueue", reason="HyperQueue is not installed: pip install hyperqueue")
engine = pytest.importorskip("hyperqueue.cluster")
# Python 3.10 has none, but pytest brings one along.
try:
    import tomllib
except ModuleNotFoundError:
    tomllib = pytest.importorskip("tomli")

N_SHARDS = 4


@pytest.fixture
def client(tmp_path: Path) -> Iterator[Any]:
    """Client of a server with two workers."""
    with engine.LocalCluster(str(tmp_path / "server")) as cluster:
        for _ in range(2):
            cluster.start_worker(engine.WorkerConfig(cores=1))
        yield cluster.client()


def test_tasks_equal_one_run(client: Any, sweep: Sweep, undisturbed: Rows) -> None:
    job = hyperqueue.Job(default_workdir=sweep.folder)
    command = [str(PROGRAM), "run", "sweep.toml", *OPTIONS, "--shard", f"auto/{N_SHARDS}"]
    tasks = [job.program(command) for _ in range(N_SHARDS)]
    job.program([str(PROGRAM), "merge", "results.db", "results.shards"], deps=tasks)
    client.wait_for_jobs([client.submit(job)])
    assert_equal(sweep.rows(), undisturbed)


def test_submitted_job_equals_one_run(client: Any, sweep: Sweep, undisturbed: Rows) -> None:
    submission = ["submit", "hyperqueue", "sweep.toml", "--shards", str(N_SHARDS), "--dry-run", "--", *OPTIONS]
    described = tomllib.loads(sweep.hypogeum(*submission))
    # The wheel has no `hq job submit-file`, so the file is submitted task by task.
    sweep.shards.mkdir(exist_ok=True)
    job = hyperqueue.Job()
    tasks: dict[int, Any] = {}
    for task in described["task"]:
        deps = [tasks[number] for number in task.get("deps", [])]
        tasks[task["id"]] = job.program(task["command"], cwd=task["cwd"], deps=deps)
    client.wait_for_jobs([client.submit(job)])
    assert_equal(sweep.rows(), undisturbed)
