"""Sweeps on engines that users have: test_slurm.py, test_hyperqueue.py, test_ssh.py, test_kubernetes.py.

Each runs the program (HYPOGEUM, or the one that the tests of Rust have built) and compares the merged rows
with those of one undisturbed run. An engine that this machine lacks is skipped with the reason:
`python -m pytest -rs tests/clusters`.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from sweep import PROGRAM, Rows, Sweep  # noqa: E402
from waiting import segments, wait_for  # noqa: E402

# Episodes per cell of the sweep of most tests: a few seconds on one core.
N_EPISODES = 10
LEFT_S = 30.0


@pytest.fixture(autouse=True)
def nothing_is_left() -> Iterator[None]:
    """Fails a test that leaves segments in shared memory. Those of other runs of this machine end by themselves."""
    before = segments()
    yield
    new = segments() - before
    wait_for("the test's shared memory to be removed", lambda: not new & segments(), LEFT_S)


@pytest.fixture(autouse=True)
def printed_logs(tmp_path: Path) -> Iterator[None]:
    """Prints the logs of all tasks, which pytest shows if the test fails."""
    yield
    for log in sorted(tmp_path.rglob("*.log")):
        print(f"== {log.relative_to(tmp_path)}\n{log.read_text(errors='replace')}")


@pytest.fixture(scope="session", autouse=True)
def program() -> Path:
    if not PROGRAM.exists():
        pytest.exit(f"{PROGRAM} does not exist; build it, or name another with HYPOGEUM", returncode=2)
    return PROGRAM


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Rows:
    """Rows of the small sweep, run on this machine."""
    return Sweep(tmp_path_factory.mktemp("undisturbed"), N_EPISODES).run()


@pytest.fixture
def sweep(tmp_path: Path) -> Sweep:
    """The small sweep, with nothing done."""
    return Sweep(tmp_path, N_EPISODES)
