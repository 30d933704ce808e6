"""Temporal ensembling: a query every control step, and the mean of all predictions for that step.

At control step `t` the executed row is `sum(w_i * a_i) / sum(w_i)` over the predictions for `t` in the last `horizon`
chunks, oldest first, with `w_i = exp(-coeff * i)`: the oldest weighs most. Run with `--mode ensemble`.
"""

import math

import numpy as np

from .chunk import as_rows

# Slots that can be followed: a bound on memory, far above what a simulator has.
MAX_SLOTS = 4096


class EnsembleError(ValueError):
    """Queries that cannot be ensembled."""


DEFAULT_COEFF = 0.01
"""Decay of the weights in the benchmark."""


class TemporalEnsemble:
    """Ensembles a policy function, which must return equally many rows in every answer to an episode; answers one."""

    def __init__(self, fn, coeff=DEFAULT_COEFF):
        self.fn = fn
        self.coeff = coeff
        self._pasts = {}

    def __call__(self, observation):
        for env in observation:
            self._check(env)
        answer = self.fn(observation)
        if len(answer) != observation.n_envs:
            raise EnsembleError(f"the policy function answered {len(answer)} envs of {observation.n_envs}")
        rows = [self._ensemble(env, chunk, observation.action_dim) for env, chunk in zip(observation, answer)]
        return np.stack(rows)[:, None]

    def _check(self, env):
        past = self._pasts.get(env.slot)
        expected = past.next_query if past else 0
        if env.query not in (0, expected):
            raise EnsembleError(f"slot {env.slot}: its query is {env.query}, expected {expected} or a new episode's 0")
        if env.query > 0 and env.step != past.next_step:
            raise EnsembleError(
                f"slot {env.slot}: {env.step - past.next_step + 1} steps since its last query, ensembling asks at "
                "every step: use `--mode ensemble`"
            )
        if past is None and len(self._pasts) == MAX_SLOTS:
            raise EnsembleError(f"more than {MAX_SLOTS} slots")

    def _ensemble(self, env, chunk, action_dim):
        chunk = as_rows(chunk, env.slot, action_dim)
        if env.query == 0:
            self._pasts[env.slot] = Past()
        return self._pasts[env.slot].push(chunk, env, self.coeff)


class Past:
    """The latest chunks of one slot's episode, oldest first."""

    def __init__(self):
        self.next_query = 0
        self.next_step = 0
        self.chunks = []

    def push(self, chunk, env, coeff):
        """Takes the newest chunk; returns the mean row for its first control step, `[action_dim] f32`."""
        horizon = len(chunk)
        if self.chunks and len(self.chunks[-1]) != horizon:
            raise EnsembleError(f"slot {env.slot}: {horizon} rows, {len(self.chunks[-1])} before")
        self.chunks = [*self.chunks, chunk][-horizon:]
        self.next_query, self.next_step = env.query + 1, env.step + 1
        # In this order, so that the sum is the same to the bit as that of the built-in policies.
        total = 0.0
        mean = np.zeros(chunk.shape[1])
        for idx, past in enumerate(self.chunks):
            weight = math.exp(-coeff * idx)
            total += weight
            mean += weight * past[len(self.chunks) - 1 - idx].astype(np.float64)
        return (mean / total).astype(np.float32)
