"""The env type `hypogeum` of LeRobot, registered when LeRobot imports this package."""

from .config import HypogeumEnvConfig

__all__ = ["HypogeumEnvConfig"]
