"""Commands whose processes are killed together, and what must be the same in the end, however often that happened."""

import hashlib
import json
import sqlite3
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
CHECKPOINT = HERE.parent.parent / "policy-host" / "tests" / "data" / "act-tiny"
TASKS = "RaiseCube,DualArmLiftTray"
# Columns of a results file that do not depend on timing, and the order of its rows.
COLUMNS = (
    "policy, task, perturbation, episode, seed, steps, success_once, success_at_end, first_success_step, "
    "failed_predicate, fingerprint, error"
)
KEY = "policy, task, perturbation, episode"
# The host in Python that a scenario may need answers with zeros.
HOST = """
import hypogeum, numpy
def zeros(observation):
    return numpy.zeros((len(observation), 1, observation.action_dim), numpy.float32)
hypogeum.serve(zeros, "zeros", forever=True)
"""


@dataclass(frozen=True)
class Scenario:
    """A command, and the part of its output that no kill may change."""

    words: tuple[str, ...]
    outcome: Callable[[Path], list]
    keeps: tuple[str, ...]
    """Names in the working folder that it may leave there."""
    hosts: tuple[str, ...] = ("host-act", "host-random")
    """Roles of its policy hosts; none if it starts no processes."""
    before: tuple[str, ...] = ()
    """A command whose output it reads."""
    has_host: bool = False
    """Whether it needs a host in Python."""


def rows(folder: Path) -> list[tuple]:
    """Returns the rows of the results file, without what depends on timing."""
    with sqlite3.connect(f"file:{folder / 'r.db'}?mode=ro", uri=True) as connection:
        found = connection.execute(f"SELECT {COLUMNS} FROM episodes ORDER BY {KEY}").fetchall()
        (damage,) = connection.execute("PRAGMA integrity_check(1)").fetchone()
    connection.close()
    if damage != "ok":
        raise ValueError(f"the results file is damaged: {damage}")
    return found


def points(folder: Path) -> list[tuple]:
    """Returns which points of the FPS experiment were measured."""
    lines = (folder / "out" / "points.jsonl").read_text().splitlines()[1:]
    measured = map(json.loads, lines)
    return sorted((point["policy"], point["mode"], point["envs"]) for point in measured)


def files(folder: Path) -> list[tuple]:
    """Returns the names of all files of the output, with the hashes of those of a dataset."""
    found = sorted(path for path in (folder / "out").rglob("*") if path.is_file())
    hashed = [(path, path.suffix in (".parquet", ".mp4", ".png")) for path in found]
    return [(str(path.relative_to(folder)), hashlib.sha256(path.read_bytes()).hexdigest() if is_data else "") for path, is_data in hashed]


def _run(*policies: str, more: tuple[str, ...] = ()) -> tuple[str, ...]:
    options = [word for policy in policies for word in ("--policy", policy)]
    options += ["--tasks", TASKS, "--perturbations", "none", "--episodes", "4", "--envs", "4", "--threads", "2"]
    return ("run", *options, "--renderer", "cpu", "--db", "r.db", *more)


ACT = f"act=act:{CHECKPOINT}"
RUN = Scenario(_run("expert", "random", ACT), rows, ("r.db",))
SCENARIOS = {
    "run": RUN,
    "until-decided": Scenario(_run("random", ACT, more=("--until-decided", "random,act")), rows, ("r.db",)),
    "latency": Scenario(_run("random", ACT, more=("--latency", "100", "--execute", "10")), rows, ("r.db",)),
    "python": Scenario(_run("random", "py=attach:zeros"), rows, ("r.db",), ("host-python", "host-random"), has_host=True),
    "fps": Scenario(
        ("fps", "--policy", "random", "--policy", ACT, "--envs", "1,4", "--mode", "chunk", "--seconds", "1", "-o", "out"),
        points, ("out",),
    ),
    "report": Scenario(("report", "r.db", "-o", "out"), files, ("r.db", "out"), (), before=RUN.words),
    "verify": Scenario(("verify", "r.db"), rows, ("r.db",), before=RUN.words),
    "demos": Scenario(("demos", "--tasks", "RaiseCube", "--episodes", "3", "-o", "out"), files, ("out",), ()),
}  # fmt: skip
