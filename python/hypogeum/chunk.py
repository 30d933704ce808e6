"""Conversion of action chunks returned by a policy function."""

import numpy as np


class AnswerError(ValueError):
    """The return value of a policy function is not a valid batch of action chunks."""


def as_rows(rows, slot, action_dim):
    """Convert one env's action chunk to `[n_rows, action_dim] f32`; `slot` only appears in error messages."""
    rows = np.asarray(to_numpy(rows))
    if rows.dtype.kind not in "fiu" or rows.ndim != 2 or rows.shape[1] != action_dim or len(rows) == 0:
        raise AnswerError(
            f"the policy function returned {list(rows.shape)} {rows.dtype} for slot {slot}, "
            f"expected [n_rows, action_dim={action_dim}] float"
        )
    if rows.dtype == np.float32:
        return rows
    # A value too large for f32 becomes infinite, which the simulator rejects.
    with np.errstate(over="ignore"):
        return rows.astype(np.float32)


def to_numpy(rows):
    """Convert a torch tensor to a numpy array; return anything else unchanged."""
    return rows.detach().float().cpu().numpy() if hasattr(rows, "detach") else rows
