"""Training as the README describes it. Set HYPOGEUM to the binary, and install lerobot and pyarrow."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from trainings import LIMIT_S, log, run, run_with_interruption

torch = pytest.importorskip("torch")

HYPOGEUM = os.environ.get("HYPOGEUM")
pytestmark = pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")
pytest.importorskip("lerobot.policies.act.modeling_act", exc_type=ImportError)
from hypogeum.lerobot import LeRobotPolicy  # noqa: E402

SCRIPT = Path(__file__).parents[1] / "train_act.py"
SMALL = "--width 8 --shrink 4 --dim 32 --layers 1 --batch-size 4 --steps 40 --save-every 5 --threads 1".split()


def command(demos, output, *options):
    return [sys.executable, SCRIPT, demos, "-o", output, *SMALL, *options]


def test_training_learns_and_resumes_after_interruption(demos, tmp_path):
    uninterrupted, resumed = tmp_path / "uninterrupted", tmp_path / "resumed"
    evaluated = command(demos, uninterrupted, "--tasks", "RaiseCube", "--evaluate", HYPOGEUM, "--episodes", "1")
    run([*evaluated, "--save-every", "20"])
    rows = log(uninterrupted)
    assert [row["step"] for row in rows] == [20, 40] and rows[-1]["loss"] < 0.9 * rows[0]["loss"]
    assert all(list(row["success_once"]) == ["RaiseCube"] for row in rows)
    assert rows[0]["is_best"] and "than_best" not in rows[0] and rows[1]["than_best"] == "undecided"

    run_with_interruption(command(demos, resumed, "--tasks", "RaiseCube"), resumed, checkpoints=8)
    weights = "model.safetensors"
    assert (uninterrupted / weights).read_bytes() == (resumed / weights).read_bytes()

    # A ResNet of a width that LeRobot does not support itself can be loaded.
    policy = LeRobotPolicy(uninterrupted)
    inputs = policy.policy.config.input_features
    batch = {name: torch.zeros(1, *feature.shape) for name, feature in inputs.items()}
    chunk = policy.infer([policy.preprocess(batch | {"task": [""]})], [(0, 0)])
    assert chunk.shape == (1, 30, 7) and np.isfinite(chunk).all() and chunk.std() > 0


@pytest.mark.parametrize(
    "options, words",
    [
        (["--tasks", "RaiseCube,StackCube"], ["has no episodes of StackCube"]),
        (["--dim", "64"], ["was made with dim 32, not 64"]),
        (["--tasks", "OpenDrawer"], ["was made from another dataset or other tasks"]),
        (["--batch-size", "4000"], ["--batch-size 4000 exceeds the", "frames of the dataset"]),
    ],
)
def test_conflicting_options_are_rejected(demos, tmp_path_factory, options, words):
    output = tmp_path_factory.getbasetemp() / "conflicting"
    short = ["--steps", "1", "--save-every", "1"]
    if not output.exists():
        run(command(demos, output, *short))
    done = subprocess.run(command(demos, output, *short, *options), capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode == 1 and all(word in done.stderr for word in words), done.stderr


def test_training_ends_within_its_time(demos, tmp_path):
    output = tmp_path / "bounded"
    endless = command(demos, output, "--steps", "1000000", "--save-every", "1000000", "--frame-stride", "3")
    run([*endless, "--max-minutes", "0.5"])
    [row] = log(output)
    assert row["seconds"] < 30 and row["step"] < 1_000_000 and (output / "model.safetensors").exists()


@pytest.fixture
def policy_and_batch():
    import train_act
    from lerobot.configs.types import FeatureType, PolicyFeature

    kinds = {train_act.STATE: FeatureType.STATE, train_act.INSTRUCTION: FeatureType.ENV}
    features = {name: PolicyFeature(kind, (3,)) for name, kind in kinds.items()}
    features["observation.images.a"] = PolicyFeature(FeatureType.VISUAL, (3, 32, 32))
    config = train_act.ACTConfig(
        input_features=features, output_features={train_act.ACTION: PolicyFeature(FeatureType.ACTION, (2,))},
        device="cpu", push_to_hub=False, pretrained_backbone_weights=None, chunk_size=5, n_action_steps=5,
        use_vae=True, dim_model=32, n_heads=2, dim_feedforward=32, n_encoder_layers=1, n_vae_encoder_layers=1,
    )  # fmt: skip
    torch.manual_seed(0)
    with train_act.resnet18_of(4):
        policy = train_act.ACTPolicy(config)
    batch = {name: torch.randn(4, *feature.shape) for name, feature in features.items()}
    batch[train_act.ACTION] = torch.randn(4, 5, 2)
    batch["action_is_pad"] = torch.arange(5) > torch.tensor([[1], [2], [3], [4]])
    return policy, batch


def test_loss_equals_lerobots(policy_and_batch):
    import train_act

    policy, batch = policy_and_batch
    losses = []
    for precision in ("f32", "bf16", None):
        torch.manual_seed(1)
        losses.append(train_act.loss_of(policy, batch, precision) if precision else policy(batch)[0])
    torch.testing.assert_close(losses[0], losses[2])
    torch.testing.assert_close(losses[1], losses[2], rtol=0.02, atol=0.02)


@pytest.mark.skipif(torch.cuda.is_available(), reason="a GPU can capture the graph")
def test_training_goes_on_without_graph(policy_and_batch, capsys):
    import train_act

    policy, batch = policy_and_batch
    gradients = train_act.Gradients(policy, "f32")
    gradients.n_eager = train_act.EAGER_STEPS
    assert gradients(batch).isfinite() and "no CUDA graph" in capsys.readouterr().out
    norm = torch.nn.utils.clip_grad_norm_(policy.parameters(), 10)
    assert norm > 0 and gradients.graph is None and gradients(batch).isfinite()


def test_frozen_normalisation_equals_torchvisions():
    import train_act

    norm = train_act.FrozenBatchNorm2d(3)
    for values in norm.buffers():
        values.uniform_(0.5, 2)
    images = torch.randn(2, 3, 4, 4)
    expected = norm(images)
    train_act.fuse(norm, torch.float32)
    torch.testing.assert_close(norm(images), expected)


def test_missing_dataset_is_named(tmp_path):
    nowhere = command(tmp_path / "nowhere", tmp_path / "out")
    done = subprocess.run(nowhere, capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode == 1 and "nowhere has no meta/hypogeum.jsonl" in done.stderr
