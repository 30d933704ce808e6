"""Serve a robot policy from Python to a Hypogeum run, reading observations directly from shared memory."""

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
