"""An observation message as arrays that lie in shared memory: nothing is copied, nothing can be written.

Axes: `n_envs` envs of the message, `n_arms` arms, `state_dim` numbers of the state vector.
"""

import warnings

import numpy as np

from .layout import (
    CONTROL_MODES,
    ENV_RECORD,
    EXTERNAL_OFFSET,
    EXTERNAL_SIDE,
    HAND_OFFSET,
    HAND_SIDE,
    INSTRUCTION_BYTES,
    MAX_HORIZON,
    MORPHOLOGIES,
    PAGE_BYTES,
    SCHEMA_HASH,
)
from .robot import CAMERAS


class FrameError(Exception):
    """A message that does not have the layout it claims."""


class Observation:
    """All envs of one message; a sequence of `EnvObservation`.

    The arrays are valid until the policy function has returned. After that the simulator writes its next observation
    there: an array that is kept shows other numbers. Copy what you keep.
    """

    morphology: str
    """"single" or "bimanual"."""
    control_mode: str
    """How the answer is read: "pd_ee_delta_pose", "pd_joint_pos" or "pd_ee_pose"."""
    n_envs: int
    action_dim: int
    """Numbers in a row of the answer."""
    states: np.ndarray
    """`[n_envs, state_dim] f32`."""
    external: "np.ndarray | None"
    """`[n_envs, 2, 224, 224, 3] u8`, RGB, top row first; None if the run draws no images."""
    hand: "np.ndarray | None"
    """`[n_envs, n_arms, 128, 128, 3] u8`, or None."""
    cameras: dict
    """`[n_envs, side, side, 3] u8` by the benchmark's camera names; empty without images."""
    instructions: list
    """Of every env; may be empty."""
    slots: list
    """Of every env: the simulator's slot, the same during an episode."""
    queries: list
    """Of every env: queries of this episode before this one; 0 marks a new episode."""
    steps: list
    """Of every env: control steps executed in this episode so far."""
    executes: list
    """Of every env: rows of the answer that will be executed."""
    policy_seeds: list
    """Of every env: seed for a policy that draws random numbers, a function of the episode alone."""

    def __init__(self, header, pages):
        """Checks a message: its `ObservationHeader`, and its pages as one `[n_bytes] u8` array."""
        check_header(header, len(pages))
        morphology = list(MORPHOLOGIES.values())[header.morphology]
        n_envs, block_bytes = header.n_envs, header.block_pages * PAGE_BYTES

        def tensor(dtype, offset, shape):
            """An array over the envs' blocks."""
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
            self.external = tensor("u1", EXTERNAL_OFFSET, (2, EXTERNAL_SIDE, EXTERNAL_SIDE, 3))
            self.hand = tensor("u1", HAND_OFFSET, (n_hands, HAND_SIDE, HAND_SIDE, 3))
            images = [self.external[:, idx] for idx in range(2)] + [self.hand[:, idx] for idx in range(n_hands)]
            self.cameras = dict(zip(CAMERAS[morphology.name], images))

    def __len__(self):
        return self.n_envs

    def __getitem__(self, env_idx):
        if not -self.n_envs <= env_idx < self.n_envs:
            raise IndexError(f"env {env_idx} of {self.n_envs}")
        return EnvObservation(self, env_idx % self.n_envs)

    def torch(self):
        """The same memory as torch tensors: "state" `[n_envs, state_dim] f32`, and every camera by its name.

        Never write to them: the memory is mapped read-only, and the process would be killed.
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
        """The simulator's slot, the same during an episode."""
        return self._all.slots[self._idx]

    @property
    def query(self):
        """Queries of this episode before this one; 0 marks a new episode."""
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
        """Seed for a policy that draws random numbers: a function of the episode alone."""
        return self._all.policy_seeds[self._idx]

    @property
    def instruction(self):
        """May be empty."""
        return self._all.instructions[self._idx]

    @property
    def state(self):
        """`[state_dim] f32`, see `hypogeum.robot.STATE_PARTS`."""
        return self._all.states[self._idx]

    @property
    def external(self):
        """`[2, 224, 224, 3] u8`, or None."""
        return None if self._all.external is None else self._all.external[self._idx]

    @property
    def hand(self):
        """`[n_arms, 128, 128, 3] u8`, or None."""
        return None if self._all.hand is None else self._all.hand[self._idx]

    @property
    def cameras(self):
        """`[side, side, 3] u8` by the benchmark's camera names."""
        return {name: images[self._idx] for name, images in self._all.cameras.items()}


def check_header(header, n_bytes):
    """Fails with the first field that does not fit."""
    if header.schema_hash != SCHEMA_HASH:
        raise FrameError(
            f"the simulator speaks link schema {header.schema_hash:#018x}, this package speaks {SCHEMA_HASH:#018x}: "
            "install the package that belongs to this hypogeum"
        )

    def check(field, fits, expected):
        if not fits:
            raise FrameError(f"header field `{field}` is {getattr(header, field)}, expected {expected}")

    check("morphology", header.morphology < len(MORPHOLOGIES), "0 or 1")
    check("control_mode", header.control_mode < len(CONTROL_MODES), "0 to 2")
    check("images", header.images <= 1, "0 or 1")
    check("n_envs", header.n_envs >= 1, "at least 1")
    block_pages = list(MORPHOLOGIES.values())[header.morphology].block_pages if header.images else 1
    check("block_pages", header.block_pages == block_pages, block_pages)
    expected = header.n_envs * block_pages * PAGE_BYTES
    if n_bytes != expected:
        raise FrameError(f"message has {n_bytes} bytes, its header implies {expected}")


def check_records(records, morphology):
    """Fails with the first record that does not fit; returns the instructions."""
    limits = (
        ("state_dim", morphology.state_dim, morphology.state_dim),
        ("instruction_len", 0, INSTRUCTION_BYTES),
        ("execute", 1, MAX_HORIZON),
    )
    for field, least, most in limits:
        for env_idx, found in enumerate(records[field].tolist()):
            if not least <= found <= most:
                expected = f"{least} to {most}" if least < most else most
                raise FrameError(f"env {env_idx}: `{field}` is {found}, expected {expected}")
    instructions = []
    for env_idx, (text, length) in enumerate(zip(records["instruction"], records["instruction_len"].tolist())):
        try:
            instructions.append(text[:length].tobytes().decode())
        except UnicodeDecodeError:
            raise FrameError(f"env {env_idx}: the instruction is not UTF-8") from None
    return instructions
