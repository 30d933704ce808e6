"""Serve a robot policy from Python to a Hypogeum run, reading observations directly from shared memory."""

import importlib
import importlib.metadata

# Module of each name, imported when the name is first used: `hypogeum.requirements` must work without numpy.
_MODULES = {
    "AnswerError": "chunk",
    "HypogeumEnv": "envs",
    "HypogeumVectorEnv": "envs",
    "EnvObservation": "observation",
    "FrameError": "observation",
    "Observation": "observation",
    "Statistics": "host",
    "TemporalEnsemble": "ensemble",
    "make_vec": "envs",
    "serve": "host",
}
__all__ = list(_MODULES)


def __getattr__(name):
    if name == "__version__":
        return importlib.metadata.version("hypogeum")
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
