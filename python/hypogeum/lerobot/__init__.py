"""Serve policies saved by LeRobot: `python -m hypogeum.lerobot NAME CHECKPOINT`.

The checkpoint folder contains `config.json`, `model.safetensors` and LeRobot's pre- and post-processors.
`hypogeum.mapping` determines the sources of its input features.
"""

__all__ = ["LeRobotPolicy"]


def __getattr__(name):
    """Import the policy when it is first used, because the command line and its help need neither torch nor LeRobot."""
    if name != "LeRobotPolicy":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from .policy import LeRobotPolicy

    return LeRobotPolicy
