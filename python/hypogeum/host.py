"""Serving loop of a policy: receives observations and sends action chunks until the run ends."""

import logging
import time
import weakref
from dataclasses import dataclass

import numpy as np

from .checksum import DamagedError, check_checksum
from .chunk import AnswerError, as_rows, to_numpy
from .ensemble import DEFAULT_COEFF, TemporalEnsemble
from .endpoint import wait_for_endpoint
from .execution import ENSEMBLE, RunRefused
from .layout import MAX_HORIZON
from .observation import FrameError, Observation

# Time to poll for a message before sleeping: longer than a fast simulator needs to send the next one.
SPIN_S = 50e-6
# Status of an answer for which the policy produced no valid actions, or whose observation was damaged.
STATUS_FAILED = 1
STATUS_DAMAGED = 2
# Maximum sleep before the host checks whether the run is still alive.
SLEEP_S = 0.1

log = logging.getLogger("hypogeum")


class PolicyLost(Exception):
    """A policy that can answer no more; the host leaves, and the run repeats unanswered episodes with the next one."""


@dataclass
class Statistics:
    """Counts of the work done by `serve`."""

    runs: int = 0
    batches: int = 0
    """Answered observation messages."""
    queries: int = 0
    """Answered envs."""
    failed: int = 0
    """Messages for which the policy produced no valid actions."""
    busy_s: float = 0.0
    """CPU time in seconds spent in the policy function and in validating its results."""


def serve(
    fn, name="mine", *, base=None, timeout_s=None, forever=False, on_error="report", ensemble_coeff=DEFAULT_COEFF,
    on_ready=None,
) -> Statistics:  # fmt: skip
    """Serve a policy function to `hypogeum run --policy ...=attach:NAME` until the run ends.

    If `fn` raises or returns an invalid result, the episodes in that message end with an error in the results, and the
    reason is logged. A non-finite action ends only its own env's episode.

    Args:
        fn: Policy function. It receives an `Observation` and returns one action chunk per env: either
            `[n_envs, n_rows, action_dim]` or a list of `[n_rows, action_dim]`, as numpy arrays or torch tensors of any
            float dtype. The simulator executes the first `execute` rows of a chunk; after a shorter chunk the next
            query comes sooner. If it has a method `on_attach`, that is called with each run's `EndpointDescriptor`
            before the host attaches, and may raise `RunRefused`.
        name: NAME of `attach:NAME`.
        base: Folder that contains the runs, if not the default.
        timeout_s: Maximum wait for the run in seconds; None waits indefinitely.
        forever: Whether to serve the next run when one ends, until interrupted by Ctrl-C.
        on_error: `"report"` continues after an error of `fn`; `"raise"` detaches from the lane and raises it.
        ensemble_coeff: Coefficient with which a run with `--mode ensemble` is ensembled (see `TemporalEnsemble`). None
            sends the chunks of `fn` unchanged.
        on_ready: Function that is called whenever the host has attached to a run.

    Returns:
        `Statistics` of the work done.

    Raises:
        TimeoutError: No run appeared within `timeout_s`.
        RunRefused: `fn.on_attach` refused the run. With `forever`, this is logged instead.
        PolicyLost: `fn` can answer no more.
    """
    # Imported here so that the rest of the package works without iceoryx2.
    from .link import Lane, RunEnded

    if on_error not in ("report", "raise"):
        raise ValueError(f'on_error is {on_error!r}, expected "report" or "raise"')
    statistics, served = Statistics(), set()
    while True:
        endpoint = wait_for_endpoint(name, base, timeout_s, served)
        served.add(endpoint.path)
        try:
            if hasattr(fn, "on_attach"):
                fn.on_attach(endpoint)
            with Lane(endpoint) as lane:
                log.info("serving %s, attached as %r", endpoint.root, name)
                statistics.runs += 1
                if on_ready is not None:
                    on_ready()
                ensembling = endpoint.mode == ENSEMBLE and ensemble_coeff is not None
                policy = TemporalEnsemble(fn, ensemble_coeff) if ensembling else fn
                _Host(lane, policy, on_error == "raise", statistics).run()
        except RunEnded:
            continue
        except RunRefused as refusal:
            if not forever:
                raise
            log.error("refused the run in %s: %s", endpoint.root, refusal)
        if not forever:
            return statistics


class _Host:
    """Serving loop of one run."""

    def __init__(self, lane, fn, raise_errors, statistics):
        self.lane = lane
        self.fn = fn
        self.raise_errors = raise_errors
        self.statistics = statistics
        self.warned = False

    def run(self):
        idle_since = time.perf_counter()
        while True:
            message = self.lane.receive()
            if message is not None:
                self.answer(message)
                idle_since = time.perf_counter()
            elif time.perf_counter() - idle_since >= SPIN_S:
                self.lane.wait(SLEEP_S)
                if not self.lane.has_message() and not self.lane.endpoint.run_is_alive():
                    return
                idle_since = time.perf_counter()

    def answer(self, message):
        pages = weakref.ref(message.pages)
        start = time.process_time()
        failure = fill = None
        try:
            fill = self.act(message)
        except BaseException as error:
            if isinstance(error, PolicyLost) or not isinstance(error, Exception):
                message.release()
                raise
            failure = error
        # After the policy has read it: then the answer is to what was sent, or there is none.
        try:
            check_checksum(message.header, message.pages)
        except DamagedError as error:
            failure = error
        self.statistics.busy_s += time.process_time() - start
        self.statistics.batches += 1
        self.statistics.queries += message.header.n_envs
        if failure is None:
            self.lane.reply(message, 0, fill)
        else:
            damaged = isinstance(failure, DamagedError)
            self.statistics.failed += 1
            self.lane.reply(message, STATUS_DAMAGED if damaged else STATUS_FAILED, fill_placeholder)
            if self.raise_errors and not damaged:
                raise failure
            self.report(failure, "run again" if damaged else "end with an error")
        # Drop our own references to the observation, so that the check below sees only the policy function's.
        failure = fill = None
        if pages() is not None and not self.warned:
            self.warned = True
            log.warning(
                "the policy function retained an array of an observation, whose contents will change with the next "
                "one; keep copies instead"
            )

    def act(self, message):
        """Run the policy on a message and return a function that writes the resulting action blocks."""
        found, expected = message.header.run, self.lane.endpoint.run
        if found != expected:
            raise FrameError(f"the observation belongs to run {found:#x}, this host serves run {expected:#x}")
        observation = Observation(message.header, message.pages)
        chunks = as_chunks(self.fn(observation), observation)
        slots, queries, action_dim = observation.slots, observation.queries, observation.action_dim

        def fill(blocks):
            blocks["slot"], blocks["query"], blocks["action_dim"] = slots, queries, action_dim
            blocks["n_rows"] = [len(chunk) for chunk in chunks]
            for rows, chunk in zip(blocks["rows"], chunks):
                rows[: chunk.size] = chunk.ravel()

        return fill

    def report(self, failure, consequence):
        expected = isinstance(failure, (AnswerError, FrameError))
        log.error(
            "failed to answer an observation: %s: %s; the episodes in it %s",
            type(failure).__name__,
            failure,
            consequence,
            exc_info=None if expected else failure,
        )


def fill_placeholder(blocks):
    """Write the blocks of a message with an error status: the smallest valid chunk per env."""
    blocks["n_rows"] = blocks["action_dim"] = 1


def as_chunks(answer, observation):
    """Validate and convert the return value of a policy function.

    Args:
        answer: Array or tensor `[n_envs, n_rows, action_dim]`, or a list of `n_envs` arrays `[n_rows, action_dim]`.
        observation: The `Observation` it answers.

    Returns:
        A list of `n_envs` arrays `[n_rows, action_dim] f32` with at most MAX_HORIZON rows.

    Raises:
        AnswerError: The type, shape or dtype is wrong.
    """
    n_envs, action_dim = observation.n_envs, observation.action_dim
    if hasattr(answer, "detach"):
        answer = to_numpy(answer)
    if not isinstance(answer, (np.ndarray, list, tuple)) or len(np.shape(answer[:0])) == 0:
        found = type(answer).__name__
        raise AnswerError(f"the policy function returned {found}, expected an array or a list of arrays")
    if isinstance(answer, np.ndarray) and answer.ndim != 3 or len(answer) != n_envs:
        found = list(answer.shape) if isinstance(answer, np.ndarray) else f"a list of {len(answer)}"
        raise AnswerError(
            f"the policy function returned {found}, expected [n_envs={n_envs}, n_rows, action_dim={action_dim}]"
        )
    chunks = [as_rows(rows, slot, action_dim) for rows, slot in zip(answer, observation.slots)]
    return [rows if len(rows) <= MAX_HORIZON else rows[:execute] for rows, execute in zip(chunks, observation.executes)]
