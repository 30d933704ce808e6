"""Comparison of two policies on matched episodes, as `hypogeum compare` makes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

BETTER, NOT_BETTER, UNDECIDED = "better", "not better", "undecided"
# Verdict by the program's decision, of which A is the side that is asked about.
VERDICTS = {"a_better": BETTER, "b_better": NOT_BETTER, "equivalent": NOT_BETTER, "undecided": UNDECIDED}
OVERALL = "overall"


@dataclass(frozen=True)
class Flip:
    """A matched episode in which exactly one side succeeds."""

    task: str
    perturbation: str
    episode: int
    gained: bool
    """Whether the newer side is the one that succeeds."""
    failed_predicate: str | None
    """What the other side did not achieve at the end."""


class Comparison:
    """Whether a policy is better than a previous one, by episodes that both have.

    The numbers are those of `hypogeum compare --json`, which are in `data` and defined in docs/conclusions.md: those of
    the cell if there is only one, or else the mean over all cells.

    Args:
        data: Output of `hypogeum compare --json`.
        name: Name of the policy.
        previous: Name of the previous one.
    """

    def __init__(self, data: dict[str, Any], name: str, previous: str) -> None:
        self.data = data
        self.name = name
        self.previous = previous
        cells, groups = data["cells"], data["groups"]
        overall = cells if len(cells) == 1 else [group for group in groups if group["group"] == OVERALL]
        self._overall: dict[str, Any] | None = overall[0] if overall else None

    @property
    def verdict(self) -> str:
        """The conclusion, at the level of `hypogeum compare` (5 %, adjusted for all cells or means of its table).

        - `"better"`: the success rate is higher.
        - `"not better"`: it is lower, or there is no difference larger than the margin (5 points).
        - `"undecided"`: neither has been shown; more episodes are needed. So it is, too, if there is no mean, because
          cells of different size ended when they were decided (`--until-decided`).
        """
        return UNDECIDED if self._overall is None else VERDICTS[self._overall["verdict"]["decision"]]

    @property
    def difference(self) -> float | None:
        """Success rate minus the previous one, -1 to 1, or None without a mean."""
        if self._overall is None:
            return None
        difference: float = self._overall["difference" if "difference" in self._overall else "mean"]
        return difference

    @property
    def interval(self) -> tuple[float, float] | None:
        """95 % interval of `difference` (Tango's), or None without a mean."""
        if self._overall is None:
            return None
        low, high = self._overall["interval"]
        return low, high

    @property
    def n(self) -> int:
        """Number of matched episodes."""
        return sum(cell["n"] for cell in self.data["cells"])

    @property
    def flips(self) -> list[Flip]:
        """All episodes that only one side solved."""
        return [
            Flip(flip["task"], flip["perturbation"], flip["episode"], flip["a_succeeds"], flip["failed_predicate"])
            for flip in self.data["flips"]
        ]

    def __str__(self) -> str:
        gained = sum(flip.gained for flip in self.flips)
        cells, lost = len(self.data["cells"]), len(self.flips) - gained
        of = f"{self.n} matched episodes" + f" in {cells} cells" * (cells > 1)
        text = f"{self.name} is {self.verdict} than {self.previous}"
        if self.verdict == UNDECIDED:
            text = f"whether {self.name} is better than {self.previous} is undecided"
        if self.difference is not None and self.interval is not None:
            low, high = (100 * bound for bound in self.interval)
            confidence = 100 * (1 - self.data["levels"]["alpha"])
            text += f": {100 * self.difference:+.1f} points ({confidence:.0f} % interval {low:+.1f} to {high:+.1f})"
        text += f", {of}, {gained} newly solved and {lost} no longer"
        more = self._overall and self._overall["verdict"].get("more_episodes")
        return text + (f"; about {more} more episodes per cell would tell" if more else "")

    def __repr__(self) -> str:
        return f"<Comparison: {self}>"
