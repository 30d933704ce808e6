"""Names of the benchmark's cameras and of the parts of its state vectors.

Joint positions are in rad, finger positions in m. A pose is a position in m followed by a quaternion (w, x, y, z), both
in the world frame. With two arms, the joints of the arms are interleaved.
"""

import re

from .layout import MORPHOLOGIES

# Camera names by morphology, in the order of the images in a message: external, then hand.
CAMERAS = {name: morphology.cameras for name, morphology in MORPHOLOGIES.items()}

# (name, width) pairs by morphology, in the order of the state vector.
STATE_PARTS = {name: morphology.state_parts for name, morphology in MORPHOLOGIES.items()}


# A part of the state, and the bounds of a slice of it.
PART = re.compile(r"(\w+)(?:\[([0-9]+):([0-9]+)\])?")


def state_slice(morphology, part):
    """Return the slice of the state vector that holds `part`, such as "qpos" or "qpos[0:8]"."""
    start, match = 0, PART.fullmatch(part)
    if match is None:
        raise ValueError(f'{part!r} is neither a part of the state nor a slice of one, such as "qpos[0:8]"')
    wanted, *bounds = match.groups()
    for name, width in STATE_PARTS[morphology]:
        if name == wanted:
            first, last = (0, width) if bounds[0] is None else map(int, bounds)
            if not first < last <= width:
                raise ValueError(f"{part!r} needs bounds 0 <= start < stop <= {width}")
            return slice(start + first, start + last)
        start += width
    known = ", ".join(name for name, _ in STATE_PARTS[morphology])
    raise ValueError(f"a {morphology} robot's state has no part {wanted!r}; it has {known}")
