"""What envs run: names of tasks and perturbations, and options in the words of the command line."""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from .. import _native

TASKS = {task["name"]: task for task in _native.tasks()}
PERTURBATIONS = tuple(_native.perturbations())


class Condition(NamedTuple):
    """A task under a perturbation, or under several joined by `+`."""

    task: str
    perturbation: str


def conditions(tasks: str | Sequence[str], perturbations: str | Sequence[str]) -> list[Condition]:
    """Return every combination of tasks and perturbations.

    Raises:
        ValueError: a name is unknown, or tasks need different robots.
    """
    names = [_task(name) for name in _words("tasks", tasks)]
    changes = [_composition(name) for name in _words("perturbation", perturbations)]
    by_morphology = {TASKS[name]["morphology"]: name for name in reversed(names)}
    if len(by_morphology) > 1:
        one, other = sorted(by_morphology.values())
        raise ValueError(
            f"{one} is {TASKS[one]['morphology']} and {other} is {TASKS[other]['morphology']}: "
            "their observations have different shapes; make one vector env for each"
        )
    return [Condition(*pair) for pair in itertools.product(names, changes)]


def option_words(options: Mapping[str, object]) -> list[str]:
    """Return options as arguments of the command line; those that are `None` are left out."""
    words = []
    for name, value in options.items():
        if value is not None:
            words += [f"--{name.replace('_', '-')}", str(value)]
    return words


def _words(kind: str, names: str | Iterable[str]) -> list[str]:
    words = [names] if isinstance(names, str) else list(names)
    if not words or not all(isinstance(word, str) for word in words):
        raise ValueError(f"{kind}: expected a name or names, found {names!r}")
    return words


def _task(name: str) -> str:
    return _known("task", name, TASKS)


def _composition(name: str) -> str:
    return "+".join(_known("perturbation", part.strip(), PERTURBATIONS) for part in name.split("+"))


def _known(kind: str, name: str, known: Iterable[str]) -> str:
    by_lower = {it.lower(): it for it in known}
    if name.lower() not in by_lower:
        close = [by_lower[it] for it in difflib.get_close_matches(name.lower(), by_lower, n=3)]
        hint = f"did you mean {', '.join(close)}?" if close else f"known are {', '.join(by_lower.values())}"
        raise ValueError(f"unknown {kind} {name!r}; {hint}")
    return by_lower[name.lower()]
