"""Robot policies in simulation: environments, evaluation, and hosts that serve a policy to a run."""

import contextlib
import importlib
import importlib.metadata
import sys

# Module of each name, imported when the name is first used: `hypogeum.requirements` must work without numpy.
_MODULES = {
    "AnswerError": "chunk",
    "Comparison": "comparison",
    "Demonstration": "dataset",
    "Demonstrations": "dataset",
    "EnvObservation": "observation",
    "EvaluationError": "program",
    "FrameError": "observation",
    "HypogeumEnv": "envs",
    "HypogeumVectorEnv": "envs",
    "Observation": "observation",
    "Recording": "recording",
    "Results": "results",
    "Statistics": "host",
    "TemporalEnsemble": "ensemble",
    "evaluate": "evaluation",
    "make_vec": "envs",
    "record": "recording",
    "serve": "host",
}
__all__ = list(_MODULES)


def __getattr__(name):
    if name == "__version__":
        return importlib.metadata.version("hypogeum")
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)


# Both imports suffice for `gymnasium.make("hypogeum/RaiseCube")`. Without the extension there are no envs.
if "gymnasium" in sys.modules:
    with contextlib.suppress(ImportError):
        importlib.import_module(".envs", __name__)
