"""Test of the training script for π0.5, against LeRobot's implementation and in use."""

import importlib.util
import os
import subprocess
import sys
from argparse import Namespace
from pathlib import Path

import pytest
from trainings import LIMIT_S, log, run, run_with_interruption

torch = pytest.importorskip("torch")
pytest.importorskip("sentencepiece")
pytest.importorskip("lerobot.policies.pi05.modeling_pi05")
load_file = pytest.importorskip("safetensors.torch").load_file

SCRIPT = Path(__file__).parent.parent / "train_pi05.py"
INSTRUCTIONS = {"Lift": ["lift the cube", "raise the cube"], "Open": ["open the drawer"]}
ARGS = Namespace(
    side=28, vision=16, vision_layers=2, vision_heads=2, vision_mlp=24, prefix=24, prefix_mlp=32, expert=16,
    expert_mlp=24, layers=2, head_dim=8, vocabulary=1024, chunk=5, execute=5, denoising_steps=10,
)  # fmt: skip
HYPOGEUM = os.environ.get("HYPOGEUM")
SMALL = """--side 28 --vision 16 --vision-layers 1 --vision-heads 2 --vision-mlp 16 --prefix 16 --prefix-mlp 16 --expert 16
    --expert-mlp 16 --layers 1 --head-dim 8 --chunk 5 --execute 5 --batch-size 4 --draws 2 --threads 1""".split()


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("train_pi05", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def tokenizer(script):
    return script.Tokenizer.from_sentencepiece(script.train_tokenizer(INSTRUCTIONS, ARGS.vocabulary))


def test_state_numbers_are_one_token_each(script, tokenizer):
    numbers = list(range(256))
    without, whole = (len(tokenizer.encode(script.prompt("lift the cube", bins))) for bins in ([0], numbers))
    assert whole - without == len(numbers) - 1
    assert len({tuple(tokenizer.encode(f" {n}")) for n in numbers}) == len(numbers)


def test_loss_equals_lerobots(script, tokenizer):
    torch.manual_seed(0)
    config = script.make_config(
        ARGS, ["observation.images.a", "observation.images.b"], 3, ["x", "y", "z", "gripper"], False
    )
    network = script.random_policy(script.widths_of(ARGS), config, tokenizer).model
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
    states = torch.rand(2, 3) * 2 - 1
    tokens, mask = script.tokenize(tokenizer, ["lift the cube", "open the drawer now"], states, 40)
    assert mask.sum(1).unique().numel() == 2
    images = torch.rand(2, 2, 3, ARGS.side, ARGS.side) * 2 - 1
    actions, noise, t = torch.randn(2, ARGS.chunk, 4), torch.randn(2, 3, ARGS.chunk, 4), torch.rand(2, 3)
    ours, _ = script.flow_loss(network, script.see(network, images), tokens, mask, actions, noise, t)
    present = [torch.ones(2, dtype=torch.bool)] * 2
    for draw in range(3):
        theirs = network(list(images.transpose(0, 1)), present, tokens, mask, actions, noise[:, draw], t[:, draw])
        torch.testing.assert_close(ours[:, draw], theirs, rtol=1e-4, atol=1e-4)


def test_relative_chunks_become_the_demonstrated_positions(script, tokenizer):
    torch.manual_seed(0)
    n, width, joints, gripper = 6, 64, list(range(7)) + list(range(8, 15)), [7, 15]
    data = object.__new__(script.Examples)
    data.morphology, data.chunk, data.is_relative = "bimanual", ARGS.chunk, True
    data.action_names = [f"arm{arm}.{name}" for arm in (1, 2) for name in (*(f"joint{j}" for j in range(7)), "gripper")]
    data.vectors = {script.STATE: torch.randn(n, width), script.ACTION: torch.randn(n, len(data.action_names))}
    data.n_frames, data.ends = n, torch.full((n,), n)
    data.select_states()
    qpos = data.vectors[script.STATE][:, :18]
    observed = torch.cat([qpos[:, 0:14:2], qpos[:, 1:14:2]], dim=1)

    config = script.make_config(ARGS, ["observation.images.a"], data.states.shape[1], data.action_names, True)
    stats = data.stats()
    preprocess, postprocess = script.processors_of(config, stats, tokenizer)
    frame = torch.tensor([2])
    preprocess({script.STATE: data.states[2], "task": "lift the cube"})
    restored = postprocess(script.scaled(data.chunks(frame), stats[script.ACTION]))[0]
    expected = data.vectors[script.ACTION][[2, 3, 4, 5, 5]]
    torch.testing.assert_close(restored, expected, rtol=1e-4, atol=1e-4)

    held = postprocess(script.scaled(data.hold_still(frame), stats[script.ACTION]))[0]
    torch.testing.assert_close(held[:, joints], observed[[2] * 5], rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(held[:, gripper], data.actions[[2] * 5][:, gripper], rtol=1e-4, atol=1e-4)


def test_keyframes_are_where_a_gripper_turns(script):
    data = object.__new__(script.Examples)
    grippers = [[1, 1], [1, 1], [0, 1], [0, 0], [0, 0], [1, 0], [1, 0], [1, 0]]
    data.is_gripper, data.ends = torch.tensor([False, True, True]), torch.tensor([5] * 5 + [8] * 3)
    data.actions = torch.tensor([[7, *row] for row in grippers], dtype=torch.float32)
    data.keyframes = data.find_keyframes()
    assert data.keyframes.tolist() == [2, 2, 3, 4, 4, 7, 7, 7]
    assert data.places(torch.tensor([1, 3])).tolist() == [[2, 3, 1], [4, 4, 3]]


def command(demos, output, *options):
    return [sys.executable, SCRIPT, demos, "-o", output, "--binary", HYPOGEUM, *SMALL, *options]


@pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")
def test_training_resumes_and_continues_weights(demos, tmp_path):
    uninterrupted, resumed, continued = (tmp_path / name for name in ("uninterrupted", "resumed", "continued"))
    steps = ["--steps", "24", "--save-every", "3", "--vision-steps", "4"]
    run(command(demos, uninterrupted, *steps))
    run_with_interruption(command(demos, resumed, *steps), resumed, checkpoints=8)
    weights = "model.safetensors"
    assert (uninterrupted / weights).read_bytes() == (resumed / weights).read_bytes()
    assert ["flow" in row for row in log(uninterrupted)] == [False, False] + [True] * 6

    vision = tmp_path / "vision"
    run(command(demos, vision, "--init", uninterrupted, "--steps", "2", "--vision-steps", "2", "--lr", "0.1"))
    before, after = (load_file(folder / weights) for folder in (uninterrupted, vision))
    changed = {name for name in before if not torch.equal(before[name], after[name])}
    assert changed and all("vision_tower" in name or "multi_modal_projector" in name for name in changed), changed

    one_task = ["--tasks", "RaiseCube", "--steps", "2", "--save-every", "1", "--evaluate", "--episodes", "1"]
    run(command(demos, continued, "--init", uninterrupted, *one_task))
    rows = log(continued)
    assert [row["success_once"] for row in rows] == [{"RaiseCube": 0.0}] * 2 and rows[1]["than_best"] == "undecided"
    assert rows[1]["flow"] > 0 and (continued / weights).exists()

    wider = command(demos, tmp_path / "wider", "--init", uninterrupted, "--expert", "24")
    done = subprocess.run(wider, capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode == 1 and "has shape" in done.stderr and weights in done.stderr, done.stderr
