"""Consistency of the generated layout with its schema and with the tables of `hypogeum.robot`."""

import ctypes
import re

from hypogeum import layout
from hypogeum.robot import CAMERAS, STATE_PARTS


def schema_fields(name):
    """Return the (field, offset) pairs that the schema lists in braces after `name`, and the total size."""
    body = re.search(rf"{name} {{([^}}]*)}} (\d+)", layout.SCHEMA)
    fields = [(field.split("@")[0].split()[0], int(field.rsplit("@", 1)[1])) for field in body.group(1).split(", ")]
    return fields, int(body.group(2))


def test_headers_match_schema():
    for name, structure in (("obs header", layout.ObservationHeader), ("act header", layout.ActionHeader)):
        fields, size = schema_fields(name)
        found = [(field, getattr(structure, field).offset) for field, _ in structure._fields_]
        assert found == [("schema_hash" if field == "schema" else field, offset) for field, offset in fields]
        assert ctypes.sizeof(structure) == size == 64


def test_records_match_schema():
    for name, dtype in (("env record", layout.ENV_RECORD), ("action block", layout.ACTION_BLOCK)):
        fields, size = schema_fields(name)
        found = [(field, dtype.fields[field][1]) for field in dtype.names]
        assert found == [(field, offset) for field, offset in fields if field not in ("reserved", "zero")]
        assert dtype.itemsize == size and size % layout.PAGE_BYTES == 0
    assert layout.ENV_RECORD.itemsize == layout.PAGE_BYTES == ctypes.sizeof(layout.Page)


def test_cameras_and_state_parts_match_morphologies():
    for name, morphology in layout.MORPHOLOGIES.items():
        assert len(CAMERAS[name]) == morphology.n_external_cameras + morphology.n_hand_cameras
        assert sum(width for _, width in STATE_PARTS[name]) == morphology.state_dim
        assert tuple(morphology.action_dim) == layout.CONTROL_MODES
