"""Temporal ensembling against its formula."""

import math

import numpy as np
import pytest
from messages import observation

from hypogeum import TemporalEnsemble
from hypogeum.ensemble import EnsembleError


def executed_rows(fn, *records):
    """Query `fn` with one env per record and return the executed row of every env."""
    answer = fn(observation(n_envs=len(records), images=False, records=records))
    assert answer.shape == (len(records), 1, 7) and answer.dtype == np.float32
    return answer[:, 0]


def test_row_is_weighted_mean_of_predictions():
    rng = np.random.default_rng(1)
    horizon, n_queries = 4, 9
    chunks = rng.standard_normal((n_queries, 2, horizon, 7)).astype(np.float32)
    queue = iter(chunks)
    fn = TemporalEnsemble(lambda _: next(queue), coeff=0.3)
    for query in range(n_queries):
        found = executed_rows(fn, *({"query": query, "step": query},) * 2)
        first = max(0, query - horizon + 1)
        weights = [math.exp(-0.3 * idx) for idx in range(query - first + 1)]
        for env in range(2):
            rows = [chunks[earlier, env, query - earlier] for earlier in range(first, query + 1)]
            mean = sum(weight * row.astype(float) for weight, row in zip(weights, rows)) / sum(weights)
            np.testing.assert_allclose(found[env], mean, rtol=1e-6)


def test_new_episode_resets_history():
    value = iter([1.0, 2.0, 3.0])
    fn = TemporalEnsemble(lambda observation: np.full((1, 5, 7), next(value)))
    executed_rows(fn, {})
    assert 1 < executed_rows(fn, {"query": 1, "step": 1})[0, 0] < 1.5 + 1e-6
    assert (executed_rows(fn, {}) == 3).all()


def test_query_gaps_and_horizon_changes_are_rejected():
    fn = TemporalEnsemble(lambda observation: np.zeros((1, 5, 7)))
    with pytest.raises(EnsembleError, match="query is 1, expected 0"):
        executed_rows(fn, {"query": 1, "step": 1})
    executed_rows(fn, {})
    with pytest.raises(EnsembleError, match="--mode ensemble"):
        executed_rows(fn, {"query": 1, "step": 30})
    fn.fn = lambda observation: np.zeros((1, 6, 7))
    with pytest.raises(EnsembleError, match="chunk has 6 rows, the previous one 5"):
        executed_rows(fn, {"query": 1, "step": 1})
