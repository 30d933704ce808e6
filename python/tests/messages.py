"""Synthetic observation messages."""

from types import SimpleNamespace

import numpy as np

from hypogeum import Observation
from hypogeum.execution import Requested
from hypogeum.layout import ENV_RECORD, IMAGE_SIZES, MORPHOLOGIES, PAGE_BYTES, SCHEMA_HASH, ObservationHeader


def attached(mode=None, execute=None, morphologies=("single",), images=True):
    """Return the description of a run with these options, of which the rest has defaults."""
    rows = 1 if mode == "ensemble" else execute or 30
    return SimpleNamespace(
        mode=mode or "chunk",
        execute=rows,
        requested=Requested(mode, execute),
        morphologies=morphologies,
        images=IMAGE_SIZES if images else None,
        answer_timeout_s=120,
    )


def message(n_envs=2, morphology="single", images=True, control_mode=0, records=(), sizes=IMAGE_SIZES):
    """Return the header and the pages, `[n_bytes] u8`, of a message.

    `records[i]` overrides fields of the record of env `i`; `sizes` are those of external and hand images, (width, height).
    """
    code = list(MORPHOLOGIES).index(morphology)
    counts = (2, MORPHOLOGIES[morphology].n_hand_cameras)
    n_bytes = sum(count * width * height * 3 for count, (width, height) in zip(counts, sizes)) if images else 0
    block_pages = 1 - -n_bytes // PAGE_BYTES
    header = ObservationHeader(SCHEMA_HASH, 7, 1, 0, n_envs, block_pages, code, control_mode, int(images))
    if images:
        header.image_sizes = sum(sizes, ())
    blocks = np.zeros((n_envs, block_pages * PAGE_BYTES), np.uint8)
    for env_idx, block in enumerate(blocks):
        block[PAGE_BYTES:] = env_idx + 1
        record = block[:PAGE_BYTES].view(ENV_RECORD)[0]
        record["slot"], record["execute"] = env_idx, 30
        record["state_dim"] = MORPHOLOGIES[morphology].state_dim
        record["state"][: record["state_dim"]] = np.arange(record["state_dim"]) + 100 * env_idx
        record["instruction_len"] = 4
        record["instruction"][:4] = list(b"lift")
        for field, value in (records[env_idx] if env_idx < len(records) else {}).items():
            record[field] = value
    return header, blocks.reshape(-1)


def observation(**kwargs):
    return Observation(*message(**kwargs))
