"""Evaluation of LeRobot's policies in this process. Needs lerobot, and HYPOGEUM set to the binary."""

import os
import subprocess
import sys

import pytest

os.environ.setdefault("HF_HUB_OFFLINE", "1")
torch = pytest.importorskip("torch")
pytest.importorskip("lerobot.policies.act.modeling_act", exc_type=ImportError)

from lerobot.policies.act.modeling_act import ACTPolicy  # noqa: E402
from lerobot.policies.factory import make_pre_post_processors  # noqa: E402

import hypogeum  # noqa: E402
from hypogeum.backbone import resnet18_of, width_of  # noqa: E402
from hypogeum.lerobot.live import copy_of  # noqa: E402
from hypogeum.mapping import MappingError  # noqa: E402

HYPOGEUM = os.environ.get("HYPOGEUM")
needs_program = pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")

LIMIT_S = 300
SHORT = {"tasks": "RaiseCube", "episodes": 2, "execute": 8, "options": ("--threads", "1"), "quiet": True}


@pytest.fixture
def live(act):
    """A policy as a training has it, with its processors."""
    with resnet18_of(width_of(act)):
        policy = ACTPolicy.from_pretrained(act)
    return policy.train(), *make_pre_post_processors(policy.config, pretrained_path=str(act))


@needs_program
def test_live_policy_equals_its_checkpoint(act, live, tmp_path):
    db = tmp_path / "r.db"
    words = ["--policy", "p=attach:test-live", "--tasks", "RaiseCube", "--episodes", "2", "--execute", "8", "--quiet"]
    run = subprocess.Popen([HYPOGEUM, "run", *words, "--threads", "1", "--db", db], stdout=subprocess.DEVNULL)
    host = subprocess.Popen([sys.executable, "-m", "hypogeum.lerobot", "test-live", act, "--timeout", "60"])
    assert run.wait(LIMIT_S) == 0 and host.wait(LIMIT_S) == 0
    before = torch.get_rng_state()
    found = [row["fingerprint"] for row in hypogeum.evaluate(live, **SHORT).episodes]
    assert found == [row["fingerprint"] for row in hypogeum.Results(db).episodes] and len(set(found)) == 2
    assert live[0].training and torch.equal(before, torch.get_rng_state())
    # Weights that have changed since are those of the evaluation.
    with torch.no_grad():
        live[0].model.action_head.bias.add_(1)
    assert found != [row["fingerprint"] for row in hypogeum.evaluate(live, **SHORT).episodes]


def test_processors_are_needed(act, live):
    policy = live[0]
    policy.config.pretrained_path = None
    with pytest.raises(MappingError, match="without processors"):
        copy_of(policy)
    with pytest.raises(MappingError, match="with 1 processors"):
        copy_of(*live[:2])
    policy.config.pretrained_path = act
    assert copy_of(policy).mapping.inputs() == copy_of(*live).mapping.inputs()


@needs_program
def test_checkpoint_that_does_not_fit_is_refused(live):
    with pytest.raises(MappingError, match="add --control-mode"):
        hypogeum.evaluate(live, control_mode="pd_joint_pos", **SHORT)
