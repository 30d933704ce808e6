"""The rows of an action chunk, as a policy function may return them."""

import numpy as np


class AnswerError(ValueError):
    """What a policy function returned is no answer."""


def as_rows(rows, slot, action_dim):
    """The answer for one env, `[n_rows, action_dim] f32`."""
    rows = np.asarray(to_numpy(rows))
    if rows.dtype.kind not in "fiu" or rows.ndim != 2 or rows.shape[1] != action_dim or len(rows) == 0:
        raise AnswerError(
            f"the policy function returned {list(rows.shape)} {rows.dtype} for slot {slot}, "
            f"expected [n_rows, action_dim={action_dim}] float"
        )
    if rows.dtype == np.float32:
        return rows
    # A number too large for f32 becomes infinite, which the simulator refuses.
    with np.errstate(over="ignore"):
        return rows.astype(np.float32)


def to_numpy(rows):
    """A torch tensor as a numpy array; anything else as it is."""
    return rows.detach().float().cpu().numpy() if hasattr(rows, "detach") else rows
