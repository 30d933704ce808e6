"""Muon, an optimiser for matrices.

The step of a matrix is its averaged gradient with all singular values moved close to one, so that no direction
dominates (Jordan et al. 2024, <https://kellerjordan.github.io/posts/muon/>). It is scaled to the size of a
step of AdamW (Liu et al. 2025, arXiv 2502.16982), so that both can share a learning rate.

`torch.optim.Muon` does the same in bfloat16, which takes 20 times as long as single precision on a CPU without
instructions for it.
"""

import torch

# Coefficients and number of the Newton-Schulz iterations, from Jordan et al.
COEFFICIENTS = (3.4445, -4.7750, 2.0315)
ITERATIONS = 5
# Root mean square of a step of AdamW at a learning rate of one, from Liu et al.
RMS = 0.2


class Muon(torch.optim.Optimizer):
    """Muon with Nesterov momentum and decoupled weight decay.

    Args:
        matrices: Parameters of two dimensions.
        lr: Learning rate, as of AdamW.
        momentum: Decay of the averaged gradient, per step.
        weight_decay: Weight decay, as of AdamW.
    """

    def __init__(self, matrices, lr, momentum=0.95, weight_decay=0.0):
        super().__init__(matrices, {"lr": lr, "momentum": momentum, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self):
        """Update all matrices that have a gradient."""
        for group in self.param_groups:
            for matrix in (matrix for matrix in group["params"] if matrix.grad is not None):
                state = self.state[matrix]
                if not state:
                    state["average"] = torch.zeros_like(matrix)
                average = state["average"]
                average.lerp_(matrix.grad, 1 - group["momentum"])
                update = orthogonal(matrix.grad.lerp(average, group["momentum"]))
                matrix.mul_(1 - group["lr"] * group["weight_decay"])
                matrix.add_(update, alpha=-group["lr"] * RMS * max(matrix.shape) ** 0.5)


def orthogonal(matrix):
    """Return a matrix with the same singular vectors, and singular values between about 0.7 and 1.2."""
    x = matrix if matrix.shape[0] <= matrix.shape[1] else matrix.T
    x = x / x.norm().clamp_min(1e-7)
    a, b, c = COEFFICIENTS
    for _ in range(ITERATIONS):
        gram = x @ x.T
        x = torch.addmm(x, torch.addmm(gram, gram, gram, beta=b, alpha=c), x, beta=a)
    return x if matrix.shape[0] <= matrix.shape[1] else x.T
