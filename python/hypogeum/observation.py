"""Observation messages as read-only arrays in shared memory, without a copy.

Shapes use these axes: `n_envs` (envs in the message), `n_arms`, and `state_dim` (width of the state vector).
"""

import warnings

import numpy as np

from .layout import (
    CONTROL_MODES,
    ENV_RECORD,
    EXTERNAL_OFFSET,
    INSTRUCTION_BYTES,
    MAX_HORIZON,
    MAX_IMAGE_SIZE,
    MIN_IMAGE_SIDE,
    MORPHOLOGIES,
    PAGE_BYTES,
    SCHEMA_HASH,
)
from .robot import CAMERAS


class FrameError(Exception):
    """A message that is inconsistent with its header or with the wire layout."""


class Observation:
    """All envs of one message; a sequence of `EnvObservation`.

    The arrays are valid until the policy function returns. After that, the simulator reuses the memory for later
    observations. Copy any array that you retain.
    """

    morphology: str
    """"single" or "bimanual"."""
    control_mode: str
    """Interpretation of the actions: "pd_ee_delta_pose", "pd_joint_pos" or "pd_ee_pose"."""
    n_envs: int
    action_dim: int
    """Width of an action row."""
    states: np.ndarray
    """State vectors, `[n_envs, state_dim] f32`."""
    external: "np.ndarray | None"
    """External images, `[n_envs, 2, height, width, 3] u8`, RGB, top row first; None if the run renders no images."""
    hand: "np.ndarray | None"
    """Hand images, `[n_envs, n_arms, height, width, 3] u8`, or None."""
    cameras: dict
    """Images by camera name, `[n_envs, height, width, 3] u8` each; empty without images."""
    instructions: list
    """Language instruction per env; may be empty."""
    slots: list
    """Simulator slot per env, constant during an episode."""
    queries: list
    """Number of earlier queries in the episode, per env; 0 marks a new episode."""
    steps: list
    """Control steps executed in the episode so far, per env."""
    executes: list
    """Rows of the answer that will be executed, per env."""
    policy_seeds: list
    """Seed for a stochastic policy, per env; a function of the episode alone."""

    def __init__(self, header, pages):
        """Validate a message.

        Args:
            header: Its `ObservationHeader`.
            pages: Its pages, `[n_bytes] u8`.

        Raises:
            FrameError: A field of the header or of a record is invalid.
        """
        check_header(header, len(pages))
        morphology = list(MORPHOLOGIES.values())[header.morphology]
        n_envs, block_bytes = header.n_envs, header.block_pages * PAGE_BYTES

        def tensor(dtype, offset, shape):
            """Return an array `[n_envs, *shape]` whose first axis runs over the envs' blocks."""
            dtype = np.dtype(dtype)
            strides = [dtype.itemsize]
            for length in shape[:0:-1]:
                strides.insert(0, strides[0] * length)
            return np.ndarray((n_envs, *shape), dtype, pages, offset, (block_bytes, *strides[: len(shape)]))

        self.n_envs = n_envs
        self.morphology = morphology.name
        self.control_mode = CONTROL_MODES[header.control_mode]
        self.action_dim = morphology.action_dim[self.control_mode]
        records = tensor(ENV_RECORD, 0, ())
        self.instructions = check_records(records, morphology)
        fields = ("slot", "query", "step", "execute", "policy_seed")
        self.slots, self.queries, self.steps, self.executes, self.policy_seeds = (records[f].tolist() for f in fields)
        state_offset = ENV_RECORD.fields["state"][1]
        self.states = tensor("<f4", state_offset, (morphology.state_dim,))
        self.external = self.hand = None
        self.cameras = {}
        if header.images:
            n_hands = morphology.n_hand_cameras
            width, height, hand_width, hand_height = header.image_sizes
            self.external = tensor("u1", EXTERNAL_OFFSET, (2, height, width, 3))
            self.hand = tensor("u1", hand_offset(header), (n_hands, hand_height, hand_width, 3))
            images = [self.external[:, idx] for idx in range(2)] + [self.hand[:, idx] for idx in range(n_hands)]
            self.cameras = dict(zip(CAMERAS[morphology.name], images))

    def __len__(self):
        return self.n_envs

    def __getitem__(self, env_idx):
        if not -self.n_envs <= env_idx < self.n_envs:
            raise IndexError(f"env {env_idx} of {self.n_envs}")
        return EnvObservation(self, env_idx % self.n_envs)

    def torch(self):
        """Return the arrays as torch tensors that share their memory.

        Never write to them: the memory is mapped read-only, so a write kills the process.

        Returns:
            A dict with "state", `[n_envs, state_dim] f32`, and one entry per camera name as in `cameras`.
        """
        import torch

        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="The given NumPy array is not writable")
            arrays = {"state": self.states, **self.cameras}
            return {name: torch.from_numpy(array) for name, array in arrays.items()}


class EnvObservation:
    """One env of a message."""

    __slots__ = ("_all", "_idx")

    def __init__(self, observation, env_idx):
        self._all = observation
        self._idx = env_idx

    @property
    def slot(self):
        """Simulator slot, constant during an episode."""
        return self._all.slots[self._idx]

    @property
    def query(self):
        """Number of earlier queries in this episode; 0 marks a new episode."""
        return self._all.queries[self._idx]

    @property
    def step(self):
        """Control steps executed in this episode so far."""
        return self._all.steps[self._idx]

    @property
    def execute(self):
        """Rows of the answer that will be executed."""
        return self._all.executes[self._idx]

    @property
    def policy_seed(self):
        """Seed for a stochastic policy, a function of the episode alone."""
        return self._all.policy_seeds[self._idx]

    @property
    def instruction(self):
        """Language instruction; may be empty."""
        return self._all.instructions[self._idx]

    @property
    def state(self):
        """State vector, `[state_dim] f32`; see `hypogeum.robot.STATE_PARTS`."""
        return self._all.states[self._idx]

    @property
    def external(self):
        """External images, `[2, height, width, 3] u8`, or None."""
        return None if self._all.external is None else self._all.external[self._idx]

    @property
    def hand(self):
        """Hand images, `[n_arms, height, width, 3] u8`, or None."""
        return None if self._all.hand is None else self._all.hand[self._idx]

    @property
    def cameras(self):
        """Images by camera name, `[height, width, 3] u8` each."""
        return {name: images[self._idx] for name, images in self._all.cameras.items()}


def hand_offset(header):
    """Return the byte offset of the first hand image in an env's block."""
    width, height, *_ = header.image_sizes
    return EXTERNAL_OFFSET + 2 * width * height * 3


def check_header(header, n_bytes):
    """Raise `FrameError` for the first invalid field of a header; `n_bytes` is the size of the message's pages."""
    if header.schema_hash != SCHEMA_HASH:
        raise FrameError(
            f"the simulator uses link schema {header.schema_hash:#018x}, this package uses {SCHEMA_HASH:#018x}; "
            "install the package version that matches the hypogeum binary"
        )

    def check(field, valid, expected):
        if not valid:
            raise FrameError(f"header field `{field}` is {getattr(header, field)}, expected {expected}")

    check("morphology", header.morphology < len(MORPHOLOGIES), "0 or 1")
    check("control_mode", header.control_mode < len(CONTROL_MODES), "0 to 2")
    check("images", header.images <= 1, "0 or 1")
    check("n_envs", header.n_envs >= 1, "at least 1")
    block_pages = 1
    if header.images:
        sizes = list(header.image_sizes)
        in_range = [MIN_IMAGE_SIDE <= length <= limit for length, limit in zip(sizes, 2 * MAX_IMAGE_SIZE)]
        if not all(in_range):
            largest = "x".join(map(str, MAX_IMAGE_SIZE))
            expected = f"{MIN_IMAGE_SIDE}x{MIN_IMAGE_SIDE} to {largest} pixels"
            raise FrameError(f"header field `image_sizes` is {sizes}, expected {expected}")
        n_hands = list(MORPHOLOGIES.values())[header.morphology].n_hand_cameras
        block_pages = -(-(hand_offset(header) + n_hands * sizes[2] * sizes[3] * 3) // PAGE_BYTES)
    check("block_pages", header.block_pages == block_pages, block_pages)
    expected = header.n_envs * block_pages * PAGE_BYTES
    if n_bytes != expected:
        raise FrameError(f"the message has {n_bytes} bytes, but its header implies {expected}")


def check_records(records, morphology):
    """Raise `FrameError` for the first invalid record; return the instructions."""
    limits = (
        ("state_dim", morphology.state_dim, morphology.state_dim),
        ("instruction_len", 0, INSTRUCTION_BYTES),
        ("execute", 1, MAX_HORIZON),
    )
    for field, low, high in limits:
        for env_idx, found in enumerate(records[field].tolist()):
            if not low <= found <= high:
                expected = f"{low} to {high}" if low < high else high
                raise FrameError(f"env {env_idx}: `{field}` is {found}, expected {expected}")
    instructions = []
    for env_idx, (text, length) in enumerate(zip(records["instruction"], records["instruction_len"].tolist())):
        try:
            instructions.append(text[:length].tobytes().decode())
        except UnicodeDecodeError:
            raise FrameError(f"env {env_idx}: the instruction is not valid UTF-8") from None
    return instructions
