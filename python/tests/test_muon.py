"""Tests of Muon."""

import pytest

torch = pytest.importorskip("torch")

from hypogeum.muon import Muon, orthogonal  # noqa: E402


@pytest.mark.parametrize("shape", [(8, 8), (24, 10), (10, 24)])
def test_singular_values_become_similar(shape):
    torch.manual_seed(0)
    matrix = torch.randn(shape)
    result = orthogonal(matrix)
    values = torch.linalg.svdvals(result)
    assert 0.6 < values.min() and values.max() < 1.3, values
    # The singular vectors stay: the product with the original is symmetric and positive.
    product = result.T @ matrix
    torch.testing.assert_close(product, product.T, rtol=0, atol=1e-3)
    assert torch.linalg.eigvalsh(product).min() > -1e-3


@pytest.mark.skipif(not hasattr(torch.optim, "Muon"), reason="this version of torch has no Muon")
def test_agrees_with_torchs_muon():
    torch.manual_seed(0)
    start, grads = torch.randn(12, 20), torch.randn(6, 12, 20)
    ours, theirs = (torch.nn.Parameter(start.clone()) for _ in range(2))
    optimisers = [
        (ours, Muon([ours], lr=0.01, weight_decay=0.1)),
        (theirs, torch.optim.Muon([theirs], lr=0.01, weight_decay=0.1, adjust_lr_fn="match_rms_adamw")),
    ]
    for grad in grads:
        for matrix, optimiser in optimisers:
            matrix.grad = grad.clone()
            optimiser.step()
    change = (theirs - start).norm()
    # The other one computes in bfloat16.
    assert (ours - theirs).norm() < 0.02 * change < 0.02 * start.norm()


def test_state_continues_after_loading():
    torch.manual_seed(0)
    grads = torch.randn(4, 6, 5)
    whole, first, second = (torch.nn.Parameter(torch.ones(6, 5)) for _ in range(3))
    optimisers = {parameter: Muon([parameter], lr=0.1) for parameter in (whole, first, second)}

    def step(parameter, grad):
        parameter.grad = grad.clone()
        optimisers[parameter].step()

    for grad in grads:
        step(whole, grad)
    for grad in grads[:2]:
        step(first, grad)
    second.data.copy_(first.data)
    optimisers[second].load_state_dict(optimisers[first].state_dict())
    for grad in grads[2:]:
        step(second, grad)
    torch.testing.assert_close(second, whole, rtol=0, atol=0)
