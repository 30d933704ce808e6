"""The simulator as Gymnasium environments, in the memory of this process."""

from .register import register
from .single import HypogeumEnv
from .vector import HypogeumVectorEnv, make_vec

__all__ = ["HypogeumEnv", "HypogeumVectorEnv", "make_vec", "register"]
