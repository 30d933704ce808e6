import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
# Make the test helpers and the scripts next to the package importable; an installed package comes first.
sys.path.insert(0, str(HERE))
sys.path.append(str(HERE.parent))


@pytest.fixture(scope="session")
def act(tmp_path_factory):
    """Folder of a tiny ACT. Needs LeRobot."""
    import lerobot_checkpoints
    import torch

    torch.set_num_threads(1)
    return lerobot_checkpoints.act(tmp_path_factory.mktemp("checkpoints") / "act")


@pytest.fixture
def copy(act, tmp_path):
    """Folder of a tiny ACT that a test may change. Needs LeRobot."""
    return shutil.copytree(act, tmp_path / "checkpoint")


@pytest.fixture(scope="session")
def demos(tmp_path_factory):
    """Folder of two demonstrations each of two tasks. Needs the binary."""
    folder = tmp_path_factory.mktemp("demos")
    command = [os.environ["HYPOGEUM"], "demos", "-o", folder, "--tasks", "RaiseCube,OpenDrawer", "--episodes", "2"]
    subprocess.run(command, check=True, timeout=300)
    return folder / "single"
