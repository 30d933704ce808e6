"""Test of the training script for π0.5, against LeRobot's implementation."""

import importlib.util
from argparse import Namespace
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("sentencepiece")
pytest.importorskip("lerobot.policies.pi05.modeling_pi05")

SCRIPT = Path(__file__).parent.parent / "train_pi05.py"
INSTRUCTIONS = {"Lift": ["lift the cube", "raise the cube"], "Open": ["open the drawer"]}
ARGS = Namespace(
    side=28, vision=16, vision_layers=2, vision_heads=2, vision_mlp=24, prefix=24, prefix_mlp=32, expert=16,
    expert_mlp=24, layers=2, head_dim=8, vocabulary=1024, chunk=5, execute=5,
)  # fmt: skip


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
    numbers = list(range(script.N_BINS))
    without, whole = (len(tokenizer.encode(script.prompt("lift the cube", bins))) for bins in ([0], numbers))
    assert whole - without == len(numbers) - 1
    assert len({tuple(tokenizer.encode(f" {n}")) for n in numbers}) == len(numbers)


def test_loss_equals_lerobots(script, tokenizer):
    torch.manual_seed(0)
    config = script.make_config(ARGS, ["observation.images.a", "observation.images.b"], 3, 4)
    network = script.make_policy(ARGS, config, tokenizer).model
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
    states = torch.rand(2, 3) * 2 - 1
    tokens, mask = script.tokenize(tokenizer, ["lift the cube", "open the drawer now"], states)
    assert mask.sum(1).unique().numel() == 2
    images = torch.rand(2, 2, 3, ARGS.side, ARGS.side) * 2 - 1
    actions, noise, t = torch.randn(2, ARGS.chunk, 4), torch.randn(2, 3, ARGS.chunk, 4), torch.rand(2, 3)
    ours, _ = script.flow_loss(network, images, tokens, mask, actions, noise, t)
    present = [torch.ones(2, dtype=torch.bool)] * 2
    for draw in range(3):
        theirs = network(list(images), present, tokens, mask, actions, noise[:, draw], t[:, draw])
        torch.testing.assert_close(ours[:, draw], theirs, rtol=1e-4, atol=1e-4)
