"""The generated layout agrees with its own schema, and with what the hand-written tables say."""

import ctypes
import re

from hypogeum import layout
from hypogeum.robot import CAMERAS, STATE_PARTS


def described(name):
    """What the schema says between braces after a name: (field, offset) in order."""
    body = re.search(rf"{name} {{([^}}]*)}} (\d+)", layout.SCHEMA)
    fields = [(field.split("@")[0].split()[0], int(field.rsplit("@", 1)[1])) for field in body.group(1).split(", ")]
    return fields, int(body.group(2))


def test_headers_are_what_the_schema_says():
    for name, structure in (("obs header", layout.ObservationHeader), ("act header", layout.ActionHeader)):
        fields, size = described(name)
        found = [(field, getattr(structure, field).offset) for field, _ in structure._fields_]
        assert found == [("schema_hash" if field == "schema" else field, at) for field, at in fields]
        assert ctypes.sizeof(structure) == size == 64


def test_records_are_what_the_schema_says():
    for name, dtype in (("env record", layout.ENV_RECORD), ("action block", layout.ACTION_BLOCK)):
        fields, size = described(name)
        found = [(field, dtype.fields[field][1]) for field in dtype.names]
        assert found == [(field, at) for field, at in fields if field not in ("reserved", "zero")]
        assert dtype.itemsize == size == layout.PAGE_BYTES == ctypes.sizeof(layout.Page)


def test_cameras_and_state_parts_fill_what_a_robot_has():
    for name, morphology in layout.MORPHOLOGIES.items():
        assert len(CAMERAS[name]) == morphology.n_external_cameras + morphology.n_hand_cameras
        assert sum(width for _, width in STATE_PARTS[name]) == morphology.state_dim
        assert tuple(morphology.action_dim) == layout.CONTROL_MODES
