"""Serve policies saved by LeRobot: `python -m hypogeum.lerobot NAME CHECKPOINT`.

The checkpoint folder contains `config.json`, `model.safetensors` and LeRobot's pre- and post-processors.
`hypogeum.mapping` determines the sources of its input features.
"""

from .policy import LeRobotPolicy

__all__ = ["LeRobotPolicy"]
