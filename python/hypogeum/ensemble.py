"""Temporal ensembling (ACT, arXiv 2304.13705): a query per control step, averaged with earlier predictions for it.

At control step `t` the executed row is `sum(w_i * a_i) / sum(w_i)` over the predictions for `t` in the last `horizon`
chunks, oldest first, with `w_i = exp(-coeff * i)`, so that the oldest prediction has the largest weight. Use with
`--mode ensemble`.
"""

import math

import numpy as np

from .chunk import as_rows

# Maximum number of slots tracked at a time: bounds memory, and is far above what a simulator uses.
MAX_SLOTS = 4096


class EnsembleError(ValueError):
    """A sequence of queries that cannot be ensembled."""


DEFAULT_COEFF = 0.01
"""Weight decay used by the benchmark."""


class TemporalEnsemble:
    """Policy function that ensembles another one and returns chunks of a single row.

    The wrapped function must return the same number of rows for every query of an episode.

    Args:
        fn: Policy function to ensemble.
        coeff: Decay of the weights, per query.
    """

    def __init__(self, fn, coeff=DEFAULT_COEFF):
        self.fn = fn
        self.coeff = coeff
        self._histories = {}

    def __call__(self, observation):
        for env in observation:
            self._check(env)
        answer = self.fn(observation)
        if len(answer) != observation.n_envs:
            raise EnsembleError(
                f"the policy function returned {len(answer)} action chunks for {observation.n_envs} envs"
            )
        rows = [self._ensemble(env, chunk, observation.action_dim) for env, chunk in zip(observation, answer)]
        return np.stack(rows)[:, None]

    def _check(self, env):
        history = self._histories.get(env.slot)
        expected = history.next_query if history else 0
        if env.query not in (0, expected):
            raise EnsembleError(
                f"slot {env.slot}: query is {env.query}, expected {expected}, or 0 for a new episode"
            )
        if env.query > 0 and env.step != history.next_step:
            raise EnsembleError(
                f"slot {env.slot}: {env.step - history.next_step + 1} steps since the previous query, but ensembling "
                "needs a query at every step; use `--mode ensemble`"
            )
        if history is None and len(self._histories) == MAX_SLOTS:
            raise EnsembleError(f"more than {MAX_SLOTS} slots")

    def _ensemble(self, env, chunk, action_dim):
        chunk = as_rows(chunk, env.slot, action_dim)
        if env.query == 0:
            self._histories[env.slot] = ChunkHistory()
        return self._histories[env.slot].push(chunk, env, self.coeff)


class ChunkHistory:
    """Most recent chunks of the episode in one slot, oldest first."""

    def __init__(self):
        self.next_query = 0
        self.next_step = 0
        self.chunks = []

    def push(self, chunk, env, coeff):
        """Append a chunk and return the weighted mean row for its first control step.

        Args:
            chunk: New action chunk, `[horizon, action_dim] f32`.
            env: The `EnvObservation` it answers.
            coeff: Decay of the weights.

        Returns:
            The row to execute, `[action_dim] f32`.
        """
        horizon = len(chunk)
        if self.chunks and len(self.chunks[-1]) != horizon:
            raise EnsembleError(f"slot {env.slot}: chunk has {horizon} rows, the previous one {len(self.chunks[-1])}")
        self.chunks = [*self.chunks, chunk][-horizon:]
        self.next_query, self.next_step = env.query + 1, env.step + 1
        # Summing in this order makes the result bitwise equal to that of the built-in policies.
        total = 0.0
        mean = np.zeros(chunk.shape[1])
        for idx, earlier in enumerate(self.chunks):
            weight = math.exp(-coeff * idx)
            total += weight
            mean += weight * earlier[len(self.chunks) - 1 - idx].astype(np.float64)
        return (mean / total).astype(np.float32)
