"""Serve a robot policy from Python to a Hypogeum run, reading observations in shared memory, or evaluate it."""

import importlib

# Module of each name, imported when the name is first used: `hypogeum.requirements` must work without numpy.
_MODULES = {
    "AnswerError": "chunk",
    "Comparison": "comparison",
    "EnvObservation": "observation",
    "EvaluationError": "program",
    "FrameError": "observation",
    "Observation": "observation",
    "Results": "results",
    "Statistics": "host",
    "TemporalEnsemble": "ensemble",
    "evaluate": "evaluation",
    "serve": "host",
}
__all__ = list(_MODULES)


def __getattr__(name):
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
