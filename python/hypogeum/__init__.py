"""Serve a robot policy from Python to a run of Hypogeum. Observations are read where the simulator wrote them."""

from .ensemble import TemporalEnsemble
from .host import AnswerError, Statistics, serve
from .observation import EnvObservation, FrameError, Observation

__all__ = [
    "AnswerError",
    "EnvObservation",
    "FrameError",
    "Observation",
    "Statistics",
    "TemporalEnsemble",
    "serve",
]
