"""Serving a policy: observations in, action chunks out, until the run is over."""

import logging
import time
import weakref
from dataclasses import dataclass

import numpy as np

from .chunk import AnswerError, as_rows, to_numpy
from .ensemble import DEFAULT_COEFF, TemporalEnsemble
from .invitation import wait_for_invitation
from .layout import MAX_HORIZON
from .observation import FrameError, Observation

# How long to look for a message before sleeping: longer than a fast simulator needs for its next one.
SPIN_S = 50e-6
# Longest sleep, after which the run is looked after.
NAP_S = 0.1

log = logging.getLogger("hypogeum")


@dataclass
class Statistics:
    """Work done by `serve`."""

    runs: int = 0
    batches: int = 0
    """Observation messages answered."""
    queries: int = 0
    """Envs answered."""
    failed: int = 0
    """Messages that could not be answered with actions."""
    busy_s: float = 0.0
    """Core-seconds spent in the policy function and in checking what it returned."""


def serve(
    fn, name="mine", *, base=None, timeout_s=None, forever=False, on_error="report", ensemble_coeff=DEFAULT_COEFF
):
    """Serves `hypogeum run --policy ...=attach:NAME` with a function, until the run is over.

    `fn(observation)` gets an `Observation` and returns an action chunk per env: `[n_envs, n_rows, action_dim]`, or a
    list of `[n_rows, action_dim]`, as numpy arrays or torch tensors of any float type. Of a chunk the simulator
    executes the first `execute` rows; a shorter one is asked again sooner.

    In a run with `--mode ensemble` the chunks are ensembled here, with this coefficient (`TemporalEnsemble`); with None they
    are answered as they are.

    Waits for the run: for ever, or `timeout_s` seconds and then raises `TimeoutError`. `base` is the folder under which
    runs live, if it is not the usual one. With `forever` it goes on with the next run; Ctrl-C ends it.

    If `fn` raises, or returns what is no answer, the episodes that were asked for end with an error in the results, the
    reason is logged, and serving goes on; with `on_error="raise"` it is raised, and the lane is left. A number that is
    not finite ends only the episode of its env.

    Returns `Statistics`.
    """
    # Only here, so that what is not the link can be used where iceoryx2 is not installed.
    from .link import Lane, RunEnded

    if on_error not in ("report", "raise"):
        raise ValueError(f'on_error is {on_error!r}, expected "report" or "raise"')
    statistics, served = Statistics(), set()
    while True:
        invitation = wait_for_invitation(name, base, timeout_s, served)
        served.add(invitation.path)
        try:
            with Lane(invitation) as lane:
                log.info("serving %s, attached as %r", invitation.root, name)
                statistics.runs += 1
                ensembles = invitation.mode == "ensemble" and ensemble_coeff is not None
                policy = TemporalEnsemble(fn, ensemble_coeff) if ensembles else fn
                _Host(lane, policy, on_error == "raise", statistics).run()
        except RunEnded:
            continue
        if not forever:
            return statistics


class _Host:
    """One run."""

    def __init__(self, lane, fn, raises, statistics):
        self.lane = lane
        self.fn = fn
        self.raises = raises
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
                self.lane.wait(NAP_S)
                if not self.lane.has_message() and not self.lane.invitation.run_is_alive():
                    return
                idle_since = time.perf_counter()

    def answer(self, message):
        base = weakref.ref(message.pages)
        used = time.process_time()
        failure = blocks = None
        try:
            blocks = self.act(message)
        except Exception as error:
            failure = error
        except BaseException:
            message.release()
            raise
        self.statistics.busy_s += time.process_time() - used
        self.statistics.batches += 1
        self.statistics.queries += message.header.n_envs
        if failure is None:
            self.lane.reply(message, 0, blocks)
        else:
            self.statistics.failed += 1
            self.lane.reply(message, 1, refuse)
            if self.raises:
                raise failure
            self.report(failure)
        # What they hold of the observation is not the policy function's doing.
        failure = blocks = None
        if base() is not None and not self.warned:
            self.warned = True
            log.warning(
                "the policy function kept an array of an observation, which will show later ones; keep copies instead"
            )

    def act(self, message):
        """What writes the answer to a message."""
        found, expected = message.header.run, self.lane.invitation.run
        if found != expected:
            raise FrameError(f"the observation is of run {found:#x}, this host serves run {expected:#x}")
        observation = Observation(message.header, message.pages)
        chunks = as_chunks(self.fn(observation), observation)
        slots, queries, action_dim = observation.slots, observation.queries, observation.action_dim

        def fill(blocks):
            blocks["slot"], blocks["query"], blocks["action_dim"] = slots, queries, action_dim
            blocks["n_rows"] = [len(chunk) for chunk in chunks]
            for rows, chunk in zip(blocks["rows"], chunks):
                rows[: chunk.size] = chunk.ravel()

        return fill

    def report(self, failure):
        expected = isinstance(failure, (AnswerError, FrameError))
        log.error(
            "could not answer: %s: %s; these episodes end with an error",
            type(failure).__name__,
            failure,
            exc_info=None if expected else failure,
        )


def refuse(blocks):
    """What is sent along with a status that says there is no answer."""
    blocks["n_rows"] = blocks["action_dim"] = 1


def as_chunks(answer, observation):
    """The action chunk of every env, `[n_rows, action_dim] f32`, of at most MAX_HORIZON rows."""
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
