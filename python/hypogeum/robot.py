"""What the benchmark calls its cameras and the parts of its state vectors.

Positions are in rad and m, poses are position then quaternion (w, x, y, z) in the world frame; the joints of two arms are
interleaved.
"""

from .layout import MORPHOLOGIES

# By morphology, in the order of the images in a message: external ones first.
CAMERAS = {name: morphology.cameras for name, morphology in MORPHOLOGIES.items()}

# By morphology, in the order of the state vector: (name, width).
STATE_PARTS = {name: morphology.state_parts for name, morphology in MORPHOLOGIES.items()}


def state_slice(morphology, part):
    """Where a part lies in the state vector."""
    start = 0
    for name, width in STATE_PARTS[morphology]:
        if name == part:
            return slice(start, start + width)
        start += width
    known = ", ".join(name for name, _ in STATE_PARTS[morphology])
    raise ValueError(f"a {morphology} robot's state has no part {part!r}; it has {known}")
