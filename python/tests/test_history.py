"""Memory of several observations, and the noise of a query."""

from types import SimpleNamespace

import numpy as np
import pytest

from hypogeum import history
from hypogeum.generated import draw_noise
from hypogeum.history import EpisodeMemory, HistoryError


def env(slot, query):
    return SimpleNamespace(slot=slot, query=query)


def test_first_observation_is_repeated_and_the_oldest_dropped():
    memory = EpisodeMemory(3)
    found = []
    for query in range(4):
        memory.push(env(0, query), f"a{query}")
        memory.push(env(5, query), f"b{query}")
        found.append(memory.observations(0))
    assert found == [["a0", "a0", "a0"], ["a0", "a0", "a1"], ["a0", "a1", "a2"], ["a1", "a2", "a3"]]
    assert memory.observations(5) == ["b1", "b2", "b3"]
    memory.push(env(0, 0), "c0")
    assert memory.observations(0) == ["c0"] * 3 and memory.observations(5) == ["b1", "b2", "b3"]


def test_plan_is_executed_row_by_row_until_the_episode_ends():
    memory = EpisodeMemory(2)
    memory.push(env(0, 0), "a0")
    assert not memory.has_plan(0)
    memory.plan(0, np.arange(3))
    assert [memory.next_rows(0).tolist() for _ in range(2)] == [[0, 1, 2], [1, 2]] and memory.has_plan(0)
    memory.push(env(0, 1), "a1")
    assert memory.next_rows(0).tolist() == [2] and not memory.has_plan(0)
    memory.plan(0, np.arange(3))
    memory.push(env(0, 0), "b0")
    assert not memory.has_plan(0)


def test_unknown_earlier_observations_are_reported(monkeypatch):
    memory = EpisodeMemory(2)
    for slot, query, words in ((0, 3, "query is 3, expected 0"), (1, 1, "query is 1, expected 0")):
        with pytest.raises(HistoryError, match=words):
            memory.push(env(slot, query), "x")
    memory.push(env(0, 0), "x")
    with pytest.raises(HistoryError, match="slot 0: query is 2, expected 1"):
        memory.push(env(0, 2), "x")
    monkeypatch.setattr(history, "MAX_SLOTS", 1)
    with pytest.raises(HistoryError, match="more than 1 slots"):
        memory.push(env(1, 0), "x")


def test_noise_is_normal_and_depends_on_seed_and_query():
    noise = draw_noise(2**64 - 1, 3, (101, 99))
    assert noise.shape == (101, 99) and noise.dtype == np.float32
    assert abs(noise.mean()) < 0.02 and abs(noise.std() - 1) < 0.02
    assert (draw_noise(2**64 - 1, 3, (10,)) == noise.reshape(-1)[:10]).all()
    for other in (draw_noise(2**64 - 1, 4, (101, 99)), draw_noise(5, 3, (101, 99))):
        assert abs((noise * other).mean()) < 0.02
