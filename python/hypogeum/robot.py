"""Names of the benchmark's cameras and of the parts of its state vectors.

Joint positions are in rad, finger positions in m. A pose is a position in m followed by a quaternion (w, x, y, z), both
in the world frame. With two arms, the joints of the arms are interleaved.
"""

from .layout import MORPHOLOGIES

# Camera names by morphology, in the order of the images in a message: external, then hand.
CAMERAS = {name: morphology.cameras for name, morphology in MORPHOLOGIES.items()}

# (name, width) pairs by morphology, in the order of the state vector.
STATE_PARTS = {name: morphology.state_parts for name, morphology in MORPHOLOGIES.items()}


def state_slice(morphology, part):
    """Return the slice of the state vector that holds `part`."""
    start = 0
    for name, width in STATE_PARTS[morphology]:
        if name == part:
            return slice(start, start + width)
        start += width
    known = ", ".join(name for name, _ in STATE_PARTS[morphology])
    raise ValueError(f"a {morphology} robot's state has no part {part!r}; it has {known}")
