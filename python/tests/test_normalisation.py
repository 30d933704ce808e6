"""Completeness of statistics, with stand-ins for LeRobot's steps."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from hypogeum.lerobot.normalisation import check_statistics
from hypogeum.mapping import MappingError

STATE, HAND = "observation.state", "observation.images.hand"
FEATURES = {STATE: ("STATE", (4,)), HAND: ("VISUAL", (3, 8, 8))}
CONFIGURED = {"STATE": "MEAN_STD", "VISUAL": "MEAN_STD", "ACTION": "MIN_MAX"}


@dataclass(frozen=True)
class named:
    """Stand-in for a member of an enum of LeRobot."""

    value: str


def step(norm_map=None, features=FEATURES, **others):
    """Return a normaliser with statistics for all features; None among `others` removes one."""
    stats = {STATE: {"mean": np.zeros(4), "std": np.ones(4)}, HAND: {"mean": np.zeros(3), "std": np.ones((3, 1, 1))}}
    for name, value in others.pop("stats", {}).items():
        feature, statistic = name.rsplit(".", 1)
        stats.setdefault(feature, {})[statistic] = value
        stats[feature] = {key: found for key, found in stats[feature].items() if found is not None}
    return SimpleNamespace(
        norm_map={named(kind): named(mode) for kind, mode in (norm_map or CONFIGURED).items()},
        features={name: SimpleNamespace(type=named(kind), shape=shape) for name, (kind, shape) in features.items()},
        stats=stats, normalize_observation_keys=others.pop("keys", None),
    )  # fmt: skip


def check(*steps, configured=CONFIGURED):
    check_statistics("pre.json", [("step 3", found) for found in steps], FEATURES, configured)


@pytest.mark.parametrize(
    "found",
    [
        step(),
        step(CONFIGURED | {"STATE": "QUANTILES"}, stats={f"{STATE}.q01": [0] * 4, f"{STATE}.q99": [1] * 4}),
        step(CONFIGURED | {"STATE": "IDENTITY"}, stats={f"{STATE}.mean": None}),
        step(keys={HAND}, stats={f"{STATE}.mean": None}),
        step(stats={f"{STATE}.std": np.ones(1)}),
    ],
)
def test_complete_statistics_are_accepted(found):
    check(found)


@pytest.mark.parametrize(
    "found, words",
    [
        (
            step(stats={f"{STATE}.std": None}),
            ("normalised by MEAN_STD", f"needs {STATE}.std", f"found are {STATE}.mean, {HAND}.mean"),
        ),
        (step(CONFIGURED | {"STATE": "QUANTILES"}), (f"needs {STATE}.q01", f"{STATE}.mean, {STATE}.std")),
        (step(stats={f"so100.{STATE}.mean": [0] * 4, f"{STATE}.mean": None}), (f"so100.{STATE}.mean",)),
        (step(stats={f"{STATE}.mean": [0, 0, np.nan, 0]}), (f"{STATE}.mean is not finite: nan",)),
        (step(stats={f"{STATE}.mean": [0] * 3}), (f"{STATE}.mean has shape [3], the feature has [4]",)),
        (step(stats={f"{HAND}.mean": [0] * 8}), (f"{HAND}.mean has shape [8], the feature has [3, 8, 8]",)),
        (step({"VISUAL": "MEAN_STD"}), ("norm_map lacks STATE", "says MEAN_STD")),
        (step(CONFIGURED | {"STATE": "ZSCORE"}), ("mode ZSCORE of STATE is unknown", "QUANTILE10")),
        (step(features={HAND: FEATURES[HAND]}), (f"features lacks {STATE}", f"it has {HAND}")),
    ],
)
def test_missing_statistic_is_named(found, words):
    with pytest.raises(MappingError) as error:
        check(found)
    assert all(word in str(error.value) for word in (*words, "step 3 of pre.json"))


def test_missing_step_is_named_unless_identity():
    with pytest.raises(MappingError, match="pre.json has no step that normalises .*state.* says MEAN_STD for STATE"):
        check()
    check(configured=dict.fromkeys(CONFIGURED, "IDENTITY"))


def test_similar_statistics_are_listed_first():
    found = step(
        stats={f"a.{name}": [0] for name in "abcdefghijklmnop"} | {f"{STATE}.mean": None, f"z.{STATE}.mean": [0]}
    )
    with pytest.raises(MappingError, match=f"found are z.{STATE}.mean, {STATE}.std, a.a, .* and 8 more"):
        check(found)


def test_statistics_of_no_feature_are_listed_as_none():
    found = step()
    found.stats = {}
    with pytest.raises(MappingError, match="the statistics found are none"):
        check(found)
