"""Wire layout of the link, byte by byte. All numbers are little-endian.

Generated from ipc-types. To update it, run `HYPOGEUM_BLESS=1 cargo test -p ipc-types --test python_layout`.

An observation message consists of `n_envs` blocks of whole pages, one per env. A block holds an `ENV_RECORD` (one page)
and, if the lane has images, the external images `[2, height, width, 3] u8`, followed by the hand images
`[n_arms, height, width, 3] u8`, both of the sizes in the header. An action message consists of one `ACTION_BLOCK` (two pages) per env.
"""

import ctypes
from ctypes import c_uint8, c_uint16, c_uint32, c_uint64
from typing import NamedTuple

import numpy as np

# Description of the layout in one line. Both sides check its hash.
SCHEMA = (
    "hypogeum link v4; "
    "page 4096; "
    "obs header {schema u64@0, run u64@8, sequence u64@16, epoch u32@24, n_envs u32@28, block_pages u32@32, "
    "morphology u32@36, control_mode u32@40, images u32@44, has_checksum u32@48, checksum u32@52, "
    "image_sizes u16[4]@56} 64; "
    "env record {slot u32@0, query u32@4, step u32@8, state_dim u32@12, instruction_len u32@16, execute u32@20, "
    "policy_seed u64@24, reserved 32@32, state f32[64]@64, instruction u8[1024]@320, zero@1344} 4096; "
    "external u8[2,h,w,3]@4096; "
    "hand u8[n_arms,h,w,3] next; "
    "act header {schema u64@0, run u64@8, sequence u64@16, epoch u32@24, n_envs u32@28, status u32@32, "
    "has_checksum u32@36, checksum u32@40, reserved 20@44} 64; "
    "action block {slot u32@0, query u32@4, n_rows u32@8, action_dim u32@12, reserved 48@16, "
    "rows f32[127*16]@64} 8192; "
    "single: state 25, cameras 2+1; "
    "bimanual: state 64, cameras 2+2; "
    "control modes 0 pd_ee_delta_pose 7, 1 pd_joint_pos 8, 2 pd_ee_pose 7 per arm"
)
# xxh3-64 of `SCHEMA`.
SCHEMA_HASH = 0x13c320f61ab52ed2

PAGE_BYTES = 4096  # Size of a page, the element of every message.
MIN_IMAGE_SIDE = 64  # Smallest width and height of an image in pixels.
EXTERNAL_OFFSET = 4096  # Byte offset of the first external image in an env's block.
INSTRUCTION_BYTES = 1024  # Maximum length of an instruction in UTF-8 bytes.
MAX_STATE_DIM = 64  # Maximum width of a state vector.
MAX_ACTION_DIM = 16  # Maximum width of an action row.
MAX_HORIZON = 127  # Maximum number of rows in an action chunk.
IMAGE_SIZES = ((224, 224), (128, 128))  # The benchmark's sizes of external and hand images, (width, height).
MAX_IMAGE_SIZE = (1280, 960)  # Largest width and height of an image.


class Morphology(NamedTuple):
    """Robot set-up of the benchmark: one arm or two."""

    name: str
    n_arms: int
    n_external_cameras: int
    n_hand_cameras: int
    cameras: tuple  # names in the order of their images: external, then hand
    state_dim: int
    state_parts: tuple  # (name, width) pairs in the order of the state vector
    default_control_mode: str
    action_dim: dict  # width of an action row by control mode


# Keyed by name, in the order of the wire codes.
MORPHOLOGIES = {
    "single": Morphology(
        "single", n_arms=1, n_external_cameras=2, n_hand_cameras=1, state_dim=25,
        cameras=("external1_camera", "external2_camera", "hand_camera"),
        state_parts=(("qpos", 9), ("qvel", 9), ("tcp_pose", 7)),
        default_control_mode="pd_ee_delta_pose",
        action_dim={"pd_ee_delta_pose": 7, "pd_joint_pos": 8, "pd_ee_pose": 7},
    ),
    "bimanual": Morphology(
        "bimanual", n_arms=2, n_external_cameras=2, n_hand_cameras=2, state_dim=64,
        cameras=("external1_camera", "external2_camera", "panda1_hand_camera", "panda2_hand_camera"),
        state_parts=(
            ("qpos", 18), ("qvel", 18), ("ee1_pose", 7), ("ee2_pose", 7), ("left_arm_tcp", 7),
            ("right_arm_tcp", 7)
        ),
        default_control_mode="pd_joint_pos",
        action_dim={"pd_ee_delta_pose": 14, "pd_joint_pos": 16, "pd_ee_pose": 14},
    ),
}
# In the order of the wire codes.
CONTROL_MODES = ("pd_ee_delta_pose", "pd_joint_pos", "pd_ee_pose")


class Page(ctypes.Structure):
    """Page of shared memory, the element of every message. 4096 bytes."""

    _fields_ = [
        ("bytes", c_uint8 * PAGE_BYTES),  # at 0
    ]

    @staticmethod
    def type_name():
        return "hyp.Page.v1"


class ObservationHeader(ctypes.Structure):
    """Header of an observation message. 64 bytes."""

    _fields_ = [
        ("schema_hash", c_uint64),  # at 0
        ("run", c_uint64),  # at 8
        ("sequence", c_uint64),  # at 16
        ("epoch", c_uint32),  # at 24
        ("n_envs", c_uint32),  # at 28
        ("block_pages", c_uint32),  # at 32
        ("morphology", c_uint32),  # at 36
        ("control_mode", c_uint32),  # at 40
        ("images", c_uint32),  # at 44
        ("has_checksum", c_uint32),  # at 48
        ("checksum", c_uint32),  # at 52
        ("image_sizes", c_uint16 * 4),  # at 56
    ]

    @staticmethod
    def type_name():
        return "hyp.ObservationHeader.v1"


class ActionHeader(ctypes.Structure):
    """Header of an action message. Status 0 is success, 2 a damaged observation, any other a failed policy. 64 bytes."""

    _fields_ = [
        ("schema_hash", c_uint64),  # at 0
        ("run", c_uint64),  # at 8
        ("sequence", c_uint64),  # at 16
        ("epoch", c_uint32),  # at 24
        ("n_envs", c_uint32),  # at 28
        ("status", c_uint32),  # at 32
        ("has_checksum", c_uint32),  # at 36
        ("checksum", c_uint32),  # at 40
        ("reserved", c_uint32 * 5),  # at 44
    ]

    @staticmethod
    def type_name():
        return "hyp.ActionHeader.v1"


# First page of an env's block: everything a policy observes except the images.
ENV_RECORD = np.dtype({
    "names": [
        "slot", "query", "step", "state_dim", "instruction_len", "execute", "policy_seed", "state", "instruction",
    ],
    "formats": ["<u4", "<u4", "<u4", "<u4", "<u4", "<u4", "<u8", ("<f4", MAX_STATE_DIM), ("u1", INSTRUCTION_BYTES)],
    "offsets": [0, 4, 8, 12, 16, 20, 24, 64, 320],
    "itemsize": 4096,
})


# Answer for one env. Its rows are packed: `[n_rows, action_dim]`.
ACTION_BLOCK = np.dtype({
    "names": ["slot", "query", "n_rows", "action_dim", "rows"],
    "formats": ["<u4", "<u4", "<u4", "<u4", ("<f4", MAX_HORIZON * MAX_ACTION_DIM)],
    "offsets": [0, 4, 8, 12, 64],
    "itemsize": 8192,
})
