"""Variants of tiny LeRobot checkpoints: one for each setting and value that matters, with the verdict on it.

A `Variant` names the setting, its change of a base folder, and what Hypogeum must do with it: honour it, so that its
actions are LeRobot's; refuse it with an error that names it; or announce in a note that it makes no difference here.
"""

from dataclasses import dataclass, field

from .edits import CONFIG, set_value

HONOURED = "honoured"
# Entry of the state that never changes, with its value, for statistics without a range.
CONSTANT_ENTRY, CONSTANT = 8, 0.5


def refused(text):
    """Return the verdict that loading fails with an error that contains `text`."""
    return dict(refused=text)


def announced(text):
    """Return the verdict that a note contains `text`, and the actions are those of LeRobot without the own edits."""
    return dict(announced=text)


@dataclass
class Base:
    """A checkpoint that variants change.

    Attributes:
        folder: Committed folder, relative to policy-host's test data.
        edits: Changes that all variants share.
        n_steps: Control steps for which actions are recorded.
    """

    folder: str
    edits: list
    n_steps: int


@dataclass
class Variant:
    """A change of a checkpoint.

    Attributes:
        base: Name of the `Base`.
        setting: File or processor step, and key, separated by a space.
        change: The change in words, unique for its setting.
        edits: Changes of the base.
        own: Further changes that only Hypogeum sees, because LeRobot does not know the setting, or because it changes
            LeRobot's precision alone.
        verdict: The verdict; by default the setting is honoured.
        n_steps: Control steps for which actions are recorded, if not the base's.
    """

    base: str
    setting: str
    change: str
    edits: list = field(default_factory=list)
    own: list = field(default_factory=list)
    verdict: object = HONOURED
    n_steps: int | None = None


def config(base, key, value, verdict=HONOURED, edits=(), n_steps=None, change=None):
    """Return the variant with another value in `config.json`."""
    changes = [set_value(CONFIG, [key], value), *edits]
    return Variant(base, f"config.json {key}", change or words(value), changes, verdict=verdict, n_steps=n_steps)


def own_config(base, key, value, verdict=HONOURED):
    """Return the variant with another value in `config.json` that only Hypogeum sees."""
    own = [set_value(CONFIG, [key], value)]
    return Variant(base, f"config.json {key}", words(value), own=own, verdict=verdict)


def words(value):
    """Return a JSON value as text."""
    names = {True: "true", False: "false", None: "null"}
    return names[value] if isinstance(value, (bool, type(None))) else str(value).replace("'", "")
