"""Completeness of the statistics with which LeRobot normalises.

LeRobot passes a feature through unchanged if its statistics are missing, so that the network receives, or returns,
numbers of another scale without an error.
"""

import numpy as np

from ..mapping import MappingError

IDENTITY = "IDENTITY"
# Kind of the one feature that LeRobot normalises without looking for it in a step's features.
ACTION = "ACTION"
# Statistics that each of LeRobot's modes needs.
STATISTICS = {
    "MEAN_STD": ("mean", "std"),
    "MIN_MAX": ("min", "max"),
    "QUANTILES": ("q01", "q99"),
    "QUANTILE10": ("q10", "q90"),
}
# Maximum number of names that an error lists.
MAX_LISTED = 12


def check_statistics(where, steps, features, configured):
    """Raise `MappingError` for the first feature that would not be normalised as configured.

    Args:
        where: Description of the processor for error messages, with the name of its file.
        steps: LeRobot's normaliser steps, or unnormaliser steps, of that processor, with their descriptions.
        features: (kind, shape) of the features that pass through it, by name.
        configured: Modes by kind: `normalization_mapping` of the configuration.
    """
    for name, (kind, shape) in features.items():
        mode = configured.get(kind, IDENTITY)
        if not steps and mode != IDENTITY:
            raise MappingError(
                f"{where} has no step that normalises {name}, but normalization_mapping in config.json says {mode} for "
                f"{kind}; save the processor again with the statistics of the dataset on which it was trained"
            )
        for label, step in steps:
            check_step(f"{label} of {where}", step, name, kind, shape, mode)


def check_step(where, step, name, kind, shape, configured):
    """Raise `MappingError` if a step lacks what it needs to normalise a feature, see `check_statistics`."""
    modes = {of.value: mode.value for of, mode in step.norm_map.items()}
    feature = step.features.get(name)
    if feature is not None and kind != ACTION:
        kind = feature.type.value
    mode = modes.get(kind)
    selected = getattr(step, "normalize_observation_keys", None)
    if mode == IDENTITY or mode is None and configured == IDENTITY or selected is not None and name not in selected:
        return
    if mode is None:
        raise MappingError(
            f"{where}: norm_map lacks {kind}, but normalization_mapping in config.json says {configured}"
        )
    if mode not in STATISTICS:
        raise MappingError(f"{where}: mode {mode} of {kind} is unknown, expected {', '.join(STATISTICS)} or {IDENTITY}")
    if feature is None and kind != ACTION:
        raise MappingError(
            f"{where}: features lacks {name}, so that it would not be normalised ({mode}); "
            f"it has {listed(sorted(step.features))}"
        )
    found = step.stats or {}
    for statistic in STATISTICS[mode]:
        value = found.get(name, {}).get(statistic)
        if value is None:
            needed = f"{name}.{statistic}"
            keys = [f"{feature}.{statistic}" for feature, values in found.items() for statistic in values]
            keys.sort(key=lambda key: (not key.endswith(needed), name not in key, key))
            raise MappingError(
                f"{where}: {name} is normalised by {mode}, which needs {needed}; "
                f"the statistics found are {listed(keys)}"
            )
        check_values(f"{where}: {name}.{statistic}", value, shape if feature is None else tuple(feature.shape))


def check_values(what, value, shape):
    """Raise `MappingError` unless a statistic is finite and applies to arrays of a shape."""
    value = np.asarray(value, np.float64)
    # LeRobot applies a flat statistic of an image to its channels.
    applied = value.reshape(-1, 1, 1) if len(shape) == 3 and value.ndim == 1 else value
    try:
        fits = np.broadcast_shapes(applied.shape, shape) == tuple(shape)
    except ValueError:
        fits = False
    if not fits:
        raise MappingError(f"{what} has shape {list(value.shape)}, the feature has {list(shape)}")
    if not np.isfinite(value).all():
        raise MappingError(f"{what} is not finite: {value.ravel()[~np.isfinite(value.ravel())][0]}")


def listed(names):
    """Return names separated by commas, at most `MAX_LISTED` of them."""
    if not names:
        return "none"
    return ", ".join(names[:MAX_LISTED]) + (f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else "")
