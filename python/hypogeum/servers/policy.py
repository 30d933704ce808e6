"""Policy function that asks a server."""

import logging
import time

import numpy as np

from ..chunk import as_rows
from ..execution import ChunkSettings, RunRefused
from ..host import PolicyLost
from ..layout import MORPHOLOGIES
from ..mapping import MappingError
from .answers import ConnectionLost, ServerError
from .requests import Requests

# Part of the lane's timeout that is left for the way back.
MARGIN_S = 5.0
# Gap between two messages below which the second one may have been waiting since the first one was received.
QUEUED_S = 0.1
# Shortest time in which a server is asked at all.
LEAST_S = 3.0
# Characters of what a server says of itself that are shown.
MAX_SAID = 300
# Lost connections in a row after which the server is given up.
MAX_LOST = 3

log = logging.getLogger("hypogeum")


class ServerPolicy:
    """Policy function for `hypogeum.serve` that asks a server for each env of a message.

    Args:
        server: Protocol and connections, see the package.
        url: Address of the server, for messages.
        settings: Contents of the mapping file.
        default: Function from a morphology's name to the mapping, if the settings have none.
        connect_s: Longest wait for the server before a run in seconds.
    """

    def __init__(self, server, url, settings, default, connect_s):
        self.server, self.url, self.settings, self.default, self.connect_s = server, url, settings, default, connect_s
        self.requests = self.morphology = None
        self.timeout_s = None
        self.n_lost = 0
        self.previous = (float("-inf"), float("-inf"))
        self.warned = set()

    def connect(self):
        """Connect to the server, and return and log what it says of itself.

        Raises:
            PolicyLost: It cannot be reached in time.
        """
        metadata = self._open([0], time.monotonic() + self.connect_s)
        said = " ".join(str(metadata or "nothing").split())[:MAX_SAID]
        log.info("connected to %s, which says of itself: %s", self.url, said)
        return said

    def on_attach(self, run):
        """Prepare for a run; `serve` calls this with the run's `EndpointDescriptor`.

        Raises:
            RunRefused: The mapping is for a robot that no task of the run has.
            MappingError: The mapping does not fit the robot.
        """
        found, morphology = list(run.morphologies), self.settings.get("morphology")
        if morphology is None and len(found) > 1:
            raise RunRefused(f"the run has tasks for {' and '.join(found)} robots; set `morphology` in the mapping")
        if morphology not in (None, *found):
            raise RunRefused(f"the mapping is for a {morphology} robot, the run has no task for one; choose --tasks")
        if not run.images:
            raise RunRefused("the mapping names cameras, but the run renders no images")
        self.morphology = morphology or found[0]
        sources = self.settings.get("mapping") or self.default(self.morphology)
        self.requests = Requests(sources, self.morphology)
        self.timeout_s = run.answer_timeout_s - MARGIN_S
        self.server.prepare(self.requests)
        self._open([0], time.monotonic() + self.connect_s)
        log.info("%s %s", self.url, ChunkSettings().resolve(run).note)

    def __call__(self, observation):
        started, (previous, ended) = time.monotonic(), self.previous
        # The lane's clock runs since the message was sent, perhaps while the previous one was being answered.
        sent = previous if started - ended < QUEUED_S else started
        deadline = sent + self.timeout_s
        try:
            return self.answer(observation, deadline)
        finally:
            self.previous = started, time.monotonic()

    def answer(self, observation, deadline):
        """Return the action chunks for an observation, a list of `[n_rows, action_dim]`."""
        self.check(observation)
        if deadline - time.monotonic() < LEAST_S:
            raise ServerError(f"{self.url} answered too late for this observation, which waited behind another one")
        envs = list(observation)
        messages = self.server.encode([self.requests.request(env) for env in envs], envs)
        self._open(observation.slots, deadline)
        try:
            answers = self.server.ask(observation.slots, messages, deadline)
        except ConnectionLost as error:
            self.n_lost += 1
            if self.n_lost == MAX_LOST:
                raise PolicyLost(f"{self.url} {error}, {MAX_LOST} times in a row; look at the server's log") from error
            raise ServerError(f"{self.url} {error}; a new connection is opened for the next observation") from error
        except ServerError as error:
            raise ServerError(f"{self.url} {error}") from error
        self.n_lost = 0
        return [self.rows(answer, env, observation) for answer, env in zip(answers, envs)]

    def check(self, observation):
        """Raise `MappingError` if the mapping is not for these observations."""
        control_mode = self.settings.get("control_mode", observation.control_mode)
        found, expected = (observation.morphology, observation.control_mode), (self.morphology, control_mode)
        if found != expected:
            advice = "choose --tasks" if found[0] != expected[0] else f"add --control-mode {expected[1]} to the run"
            raise MappingError(
                f"the run uses morphology {found[0]} with control mode {found[1]}, the mapping is for {expected[0]} "
                f"with {expected[1]}; {advice}"
            )

    def rows(self, answer, env, observation):
        """Return the rows of a server's answer, `[n_rows, action_dim] f32`."""
        rows, width = np.asarray(answer), observation.action_dim
        if rows.ndim == 1:
            rows = rows[None]
            if env.execute > 1:
                self.warn_once(
                    f"{self.url} answers a single row to each query; --execute 1 lets the results say so, and if the "
                    "server buffers chunks, it needs no more"
                )
        if rows.dtype.kind not in "fiu" or rows.ndim != 2 or rows.shape[1] != width or len(rows) == 0:
            fitting = MORPHOLOGIES[self.morphology].action_dim.items()
            modes = [mode for mode, dim in fitting if rows.ndim == 2 and rows.shape[1] == dim]
            advice = f"add --control-mode {modes[0]} to the run, or serve" if modes else "serve"
            raise ServerError(
                f"{self.url} answered actions {list(rows.shape)} {rows.dtype}, expected [rows, {width}] float for "
                f"{observation.control_mode} of a {self.morphology} robot; {advice} a policy for this robot"
            )
        if not np.isfinite(rows).all():
            self.warn_once(f"{self.url} answered actions that are not finite; their episodes end with an error")
        return as_rows(rows, env.slot, width)

    def warn_once(self, text):
        """Log a warning, unless it has been logged before."""
        if text not in self.warned:
            self.warned.add(text)
            log.warning("%s", text)

    def _open(self, slots, deadline):
        try:
            return self.server.open(slots, deadline)
        except ServerError as error:
            raise PolicyLost(f"{self.url} {error}; start the server, or correct the address") from error
