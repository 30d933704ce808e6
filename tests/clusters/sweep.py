"""The sweep of these tests, and the comparison of its rows with those of one undisturbed run."""

import os
import shutil
import sqlite3
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from waiting import output_of

ROOT = Path(__file__).resolve().parents[2]
ACT = ROOT / "policy-host/tests/data/act-tiny"
PROGRAM = Path(os.environ.get("HYPOGEUM", ROOT / "target/debug/hypogeum-under-test")).resolve()
# Options of all runs. The images of a GPU would be others.
OPTIONS = ["--renderer", "cpu", "--policy-device", "cpu"]
# Columns that identify an episode.
KEY = ("policy", "task", "perturbation", "episode")
# Columns that differ between repetitions, and the one that covers them.
TIMES = {"physics_s", "render_s", "policy_s", "wait_s", "checksum"}
# Cells: two policies, three tasks, two perturbations.
N_CELLS = 12
RUN_TIMEOUT_S = 120.0

Key = tuple[object, ...]
Rows = dict[Key, dict[str, object]]

TEXT = """\
policies = ["random", "act=act:act"]
tasks = ["RaiseCube", "LiftPegUpright", "DualArmPushBox"]
perturbations = ["None", "Light-Color"]
episodes = {episodes}
db = "results.db"
"""


@dataclass
class Sweep:
    """A sweep in a folder of its own."""

    folder: Path
    episodes: int
    """Episodes per cell."""

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        # Paths below the folder mean the same on machines that mirror it.
        shutil.copytree(ACT, self.folder / "act")
        (self.folder / "sweep.toml").write_text(TEXT.format(episodes=self.episodes))

    @property
    def n_episodes(self) -> int:
        return N_CELLS * self.episodes

    @property
    def results(self) -> Path:
        return self.folder / "results.db"

    @property
    def shards(self) -> Path:
        """Folder of the shards."""
        return self.folder / "results.shards"

    def hypogeum(self, *arguments: str, env: Mapping[str, str] | None = None, timeout_s: float = RUN_TIMEOUT_S) -> str:
        """Runs the program in the folder of the sweep and returns its standard output."""
        command = ["env", f"--chdir={self.folder}", str(PROGRAM), *arguments]
        return output_of(command, env, timeout_s)

    def run(self) -> Rows:
        """Runs the sweep on this machine, undisturbed, and returns its rows."""
        self.hypogeum("run", "sweep.toml", *OPTIONS, "--quiet", env=alone())
        return self.rows()

    def rows(self) -> Rows:
        return rows_of(self.results)


def alone() -> dict[str, str]:
    """Returns the environment without what an engine says, in which these tests may run."""
    return {name: value for name, value in os.environ.items() if not name.startswith("SLURM_")}


def rows_of(file: Path) -> Rows:
    """Returns the rows of a results file by their identity, without the columns that depend on time."""
    connection = sqlite3.connect(f"file:{file}?mode=ro", uri=True)
    try:
        connection.row_factory = sqlite3.Row
        found = [dict(row) for row in connection.execute("SELECT * FROM episodes")]
    finally:
        connection.close()
    return {tuple(row[name] for name in KEY): {name: row[name] for name in row.keys() - TIMES} for row in found}


def assert_equal(found: Rows, expected: Rows) -> None:
    """Compares all rows, and names the first of those that differ."""
    __tracebackhide__ = True
    missing, further = expected.keys() - found.keys(), found.keys() - expected.keys()
    assert not missing, f"{len(missing)} rows are missing, among them {min(missing, key=str)}"
    assert not further, f"there are {len(further)} rows too many, among them {min(further, key=str)}"
    different = [key for key, row in expected.items() if found[key] != row]
    if different:
        key = different[0]
        columns = [name for name, value in expected[key].items() if found[key][name] != value]
        pytest.fail(f"{len(different)} rows differ, among them {key} in {', '.join(sorted(columns))}")
