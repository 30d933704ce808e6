"""How a checkpoint's chunks are executed: as the user says, or else as the checkpoint does.

The built-in policies resolve their settings by the same rules. For a foreign host the run has already chosen its query
mode and the number of rows when the host attaches, so that the host can only return fewer rows, or refuse the run.
"""

from dataclasses import dataclass
from typing import NamedTuple

from .ensemble import DEFAULT_COEFF
from .layout import MAX_HORIZON

CHUNK, ENSEMBLE = "chunk", "ensemble"
# Rows that are executed where neither the user nor a checkpoint says how many.
DEFAULT_ROWS = 30


class RunRefused(ValueError):
    """A run that would execute a policy differently than its checkpoint says, although nobody asked for that."""


class Requested(NamedTuple):
    """What the user of a run asked for, with None for what they left open."""

    mode: "str | None" = None
    execute: "int | None" = None


class Execution(NamedTuple):
    """How the chunks of a policy are executed in a run."""

    n_rows: "int | None"
    """Rows of each chunk to return; None for all of them."""
    note: str
    """Sentence that says what happens and who chose it."""


@dataclass(frozen=True)
class ChunkSettings:
    """What a checkpoint says about the use of its chunks."""

    n_action_steps: "int | None" = None
    """Rows to execute before the next query."""
    ensemble_coeff: "float | None" = None
    """Coefficient of the temporal ensemble, if it is to be used."""
    horizon: "int | None" = None
    """Rows of a chunk, if known."""

    def resolve(self, run):
        """Return the `Execution` in a run.

        Args:
            run: The run's `EndpointDescriptor`.

        Raises:
            RunRefused: The run's defaults are not what the checkpoint says.
        """
        if run.mode == ENSEMBLE:
            return Execution(None, f"queried at every control step, predictions averaged ({self._ensemble_reason()})")
        requested = run.requested
        if self.ensemble_coeff is not None and requested == Requested():
            raise RunRefused(
                f"the checkpoint's temporal_ensemble_coeff is {self.ensemble_coeff:g}, but this run does not average "
                "predictions; add --mode ensemble to the run, or --mode chunk to execute chunks nevertheless"
            )
        rows, reason = self._rows(run)
        if self.ensemble_coeff is not None:
            reason += f"; its own temporal_ensemble_coeff of {self.ensemble_coeff:g} is not used"
        n_rows = rows if requested.execute is None else None
        if self.horizon is not None and rows > self.horizon:
            if requested.execute is not None:
                reason += f", but {rows} is more than a chunk has"
            rows = self.horizon
        of = "" if self.horizon is None else f" of {self.horizon}"
        return Execution(n_rows, f"executes {rows}{of} rows per query ({reason})")

    def _rows(self, run):
        """Return how many rows of a chunk are executed in a run without an ensemble, and why."""
        # One row per query is what an ensemble needs, not what a chunk was trained for.
        own = self.n_action_steps if self.ensemble_coeff is None else None
        requested = run.requested.execute
        if requested is not None:
            differs = own not in (None, requested)
            return requested, f"--execute; its own n_action_steps is {own}" if differs else "--execute"
        if own is None:
            return run.execute, "the default"
        if own > run.execute:
            fitting = f"--execute {min(own, MAX_HORIZON)}"
            if own > MAX_HORIZON:
                advice = f"an answer holds at most {MAX_HORIZON} rows; add {fitting} to the run, or fewer"
            else:
                advice = f"add {fitting} to the run, or another number to query more or less often than it was trained"
            raise RunRefused(
                f"the checkpoint's n_action_steps is {own}, but this run executes {run.execute} rows a query; {advice}"
            )
        return own, "n_action_steps of the checkpoint"

    def _ensemble_reason(self):
        if self.ensemble_coeff is not None:
            return f"temporal_ensemble_coeff {self.ensemble_coeff:g}"
        own = "" if self.n_action_steps is None else f"; its own n_action_steps is {self.n_action_steps}"
        return f"--mode ensemble, coefficient {DEFAULT_COEFF:g} by default{own}"
