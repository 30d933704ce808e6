"""The ensemble against its formula."""

import math

import numpy as np
import pytest
from messages import observation

from hypogeum import TemporalEnsemble
from hypogeum.ensemble import EnsembleError


def ask(fn, *records):
    """The executed row of every env."""
    answer = fn(observation(n_envs=len(records), images=False, records=records))
    assert answer.shape == (len(records), 1, 7) and answer.dtype == np.float32
    return answer[:, 0]


def test_the_row_is_the_weighted_mean_of_all_predictions_for_the_step():
    rng = np.random.default_rng(1)
    horizon, n_queries = 4, 9
    chunks = rng.standard_normal((n_queries, 2, horizon, 7)).astype(np.float32)
    queue = iter(chunks)
    fn = TemporalEnsemble(lambda _: next(queue), coeff=0.3)
    for query in range(n_queries):
        found = ask(fn, *({"query": query, "step": query},) * 2)
        first = max(0, query - horizon + 1)
        weights = [math.exp(-0.3 * idx) for idx in range(query - first + 1)]
        for env in range(2):
            rows = [chunks[past, env, query - past] for past in range(first, query + 1)]
            mean = sum(weight * row.astype(float) for weight, row in zip(weights, rows)) / sum(weights)
            np.testing.assert_allclose(found[env], mean, rtol=1e-6)


def test_a_new_episode_forgets():
    value = iter([1.0, 2.0, 3.0])
    fn = TemporalEnsemble(lambda observation: np.full((1, 5, 7), next(value)))
    ask(fn, {})
    assert 1 < ask(fn, {"query": 1, "step": 1})[0, 0] < 1.5 + 1e-6
    assert (ask(fn, {}) == 3).all()


def test_gaps_and_changing_horizons_are_named():
    fn = TemporalEnsemble(lambda observation: np.zeros((1, 5, 7)))
    with pytest.raises(EnsembleError, match="query is 1, expected 0"):
        ask(fn, {"query": 1, "step": 1})
    ask(fn, {})
    with pytest.raises(EnsembleError, match="--mode ensemble"):
        ask(fn, {"query": 1, "step": 30})
    fn.fn = lambda observation: np.zeros((1, 6, 7))
    with pytest.raises(EnsembleError, match="6 rows, 5 before"):
        ask(fn, {"query": 1, "step": 1})
