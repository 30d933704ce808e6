"""The simulator as in-process Gymnasium environments."""

from ..requirements import explain

try:
    from .register import register
    from .single import HypogeumEnv
    from .vector import HypogeumVectorEnv, make_vec
except ImportError as error:
    raise ImportError(explain(error, "pip install './python[gym]'")) from error

register()
__all__ = ["HypogeumEnv", "HypogeumVectorEnv", "make_vec", "register"]
