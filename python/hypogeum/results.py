"""Results files of `hypogeum run`: cells, episodes, comparisons, movies. Numbers and definitions are the program's."""

from __future__ import annotations

import html
import json
import os
import sqlite3
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from zipfile import ZipFile, is_zipfile

from .comparison import Comparison, Flip
from .program import EvaluationError, call, find_program

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

NO_PERTURBATION = "None"
# Columns of the table `episodes` that only the program reads.
INTERNAL = ("checksum", "actions")
KEY = ("policy", "task", "perturbation", "episode")


@dataclass(frozen=True)
class Cell:
    """Success of a policy at a task under a perturbation."""

    policy: str
    task: str
    perturbation: str
    n: int
    """Episodes without an error."""
    successes: int
    """Episodes in which the goal was reached after any step (`success_once`)."""
    rate: float
    """`successes / n`, or nan without episodes."""
    low: float
    high: float
    """95 % interval of the rate (Wilson's)."""
    errors: int
    """Episodes that ended with an error. They count neither as success nor as failure."""


class Results:
    """The results in one or several files of `hypogeum run` or packages of `hypogeum pack`, read when first used.

    Args:
        path: Results file or package.
        more_paths: Further ones, which must agree on everything that results depend on, such as the seed.
        policy: Name of a policy, to leave out all others.
        across: Options that may differ between the files, such as `"seed"`.
        program: Path of the program, if it is not found by itself (see `hypogeum.program.find_program`).
        folder: Temporary folder that is to last as long as this object.

    All methods raise `EvaluationError` if a file is missing, damaged or not one of results.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *more_paths: str | os.PathLike[str],
        policy: str | None = None,
        across: Sequence[str] = (),
        program: str | os.PathLike[str] | None = None,
        folder: TemporaryDirectory[str] | None = None,
    ) -> None:
        self.paths = tuple(map(Path, (path, *more_paths)))
        self.policy = policy
        self.across = tuple(across)
        self._program = program
        self._folder = folder

    @cached_property
    def cells(self) -> list[Cell]:
        """A `Cell` per policy, task and perturbation, in the program's order."""
        return [cell(found) for found in self._report["cells"] if self.policy in (None, found["policy"])]

    @cached_property
    def episodes(self) -> list[dict[str, Any]]:
        """The rows of all files, sorted by policy, task, perturbation and episode, as dictionaries.

        The keys are the columns in docs/results.md, such as `success_once`, `steps`, `fingerprint` and `error`, and
        `file`, the path of the row's file. Successes are of type bool.
        """
        # The program checks the files.
        self._report  # noqa: B018
        return [row for path in self.paths for row in read_rows(path) if self.policy in (None, row["policy"])]

    def frame(self) -> pd.DataFrame:
        """Return `episodes` as a data frame of pandas, one row per episode.

        Raises:
            ModuleNotFoundError: pandas is not installed.
        """
        try:
            import pandas
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError("Results.frame needs pandas: pip install pandas", name=error.name) from error
        return pandas.DataFrame(self.episodes)

    def compare(
        self,
        previous: Results,
        *,
        metric: str = "success_once",
        margin: float | None = None,
    ) -> Comparison:
        """Compare with earlier results on twins: episodes of the same task, perturbation and index.

        Each side is one policy, by whatever name, in one results file. The two may be in the same file.

        Args:
            previous: The other side.
            metric: `"success_once"` or `"success_at_end"`.
            margin: Smallest difference of success rates that matters; 0.05 by default.

        Raises:
            EvaluationError: A side has several policies or files, the files differ in an option, or the two have no
                episode in common.
        """
        (path, name), (other, other_name) = self._side(), previous._side()
        sides, files = [name, other_name], [path]
        if not path.samefile(other):
            files.append(other)
            names = [found["name"] for results in (self, previous) for found in results._report["policies"]]
            # The program tells policies of one name apart by their files.
            sides = [f"{file}:{side}" if names.count(side) > 1 else side for file, side in zip(files, sides)]
        across = sorted({"policy", *self.across, *previous.across})
        words = ["--json", "--metric", metric, "--across", ",".join(across), "--a", sides[0], "--b", sides[1]]
        words += [] if margin is None else ["--margin", str(margin)]
        before = other_name if other_name != name else f"the previous {other_name}"
        return Comparison(json.loads(self._call("compare", *files, *words)), name, before)

    def replay(self, i: int | Flip, *, scale: int = 1, stride: int = 1) -> np.ndarray[Any, np.dtype[np.uint8]]:
        """Execute a stored episode again and return what its cameras see, `[n_frames, height, width, 3] u8`.

        A frame shows all cameras side by side, above one line of text. The first is before the first control step, of
        which there are 20 per second.

        Args:
            i: Index into `episodes`, or a flip of a comparison of these results.
            scale: Resolution as a multiple, 1 to 8, of what policies receive.
            stride: Keep every nth frame, and the last one.

        Raises:
            ModuleNotFoundError: Pillow is not installed.
            EvaluationError: The actions were not stored, or the episode is not reproduced bit for bit.
        """
        import numpy as np

        try:
            from PIL import Image, ImageSequence
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError("Results.replay needs Pillow: pip install pillow", name=error.name) from error
        if isinstance(i, Flip):
            i = [[row[key] for key in KEY[1:]] for row in self.episodes].index([i.task, i.perturbation, i.episode])
        row = self.episodes[i]
        with TemporaryDirectory(prefix="hypogeum-") as folder:
            movie = Path(folder, "episode.png")
            words = ["replay", row["file"], "--movie", movie, "--scale", str(scale), "--stride", str(stride)]
            flags = zip(("--policy", "--task", "--perturbation", "--index"), KEY)
            self._call(*words, *(word for flag, key in flags for word in (flag, str(row[key]))))
            with Image.open(movie) as frames:
                return np.stack([np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(frames)])

    def log(self, run: Any, step: int | None = None, prefix: str = "eval") -> None:
        """Log the success rates to an experiment tracker.

        Logged are `PREFIX/success_once` and `PREFIX/errors` over all cells, `PREFIX/success_once/TASK` of each cell
        (with `/PERTURBATION` if there is one, and the policy's name before the task if there are several), and the
        table `PREFIX/cells`.

        Args:
            run: A run of wandb or trackio, one of these modules, or anything with a method `log(dict, step=...)`, which
                then gets no table.
            step: Step of the training, if the tracker is not to count by itself.
            prefix: First part of the names.
        """
        cells = self.cells
        n, several = sum(cell.n for cell in cells), len({cell.policy for cell in cells}) > 1
        values: dict[str, Any] = {f"{prefix}/errors": sum(cell.errors for cell in cells)}
        if n > 0:
            values[f"{prefix}/success_once"] = sum(cell.successes for cell in cells) / n
        for cell in cells:
            parts = [cell.policy] * several + [cell.task] + [cell.perturbation] * (cell.perturbation != NO_PERTURBATION)
            values["/".join([prefix, "success_once", *parts])] = cell.rate
        owner = getattr(run, "__name__", None) or type(run).__module__
        table = getattr(sys.modules.get(owner.split(".")[0]), "Table", None)
        if table is not None:
            names = [field.name for field in fields(Cell)]
            values[f"{prefix}/cells"] = table(columns=names, data=[list(asdict(cell).values()) for cell in cells])
        run.log(values, step=step)

    def __repr__(self) -> str:
        of = "" if self.policy is None else f", policy={self.policy!r}"
        return f"Results({', '.join(repr(str(path)) for path in self.paths)}{of})"

    def __str__(self) -> str:
        return "\n".join("  ".join(row) for row in table_rows(self.cells))

    def _repr_html_(self) -> str:
        """Return the table of cells, for notebooks."""
        head, *body = ([html.escape(text.strip()) for text in row] for row in table_rows(self.cells))
        lines = [f"<tr>{''.join(f'<td>{text}</td>' for text in row)}</tr>" for row in body]
        return f"<table><tr>{''.join(f'<th>{text}</th>' for text in head)}</tr>{''.join(lines)}</table>"

    @cached_property
    def _report(self) -> dict[str, Any]:
        """What the program reports on the files: `cells`, `policies` and more."""
        with TemporaryDirectory(prefix="hypogeum-") as folder:
            across = ["--across", ",".join(self.across)] if self.across else []
            self._call("report", *self.paths, "--output", folder, *across)
            report: dict[str, Any] = json.loads(Path(folder, "data.json").read_text())
            return report

    def _side(self) -> tuple[Path, str]:
        """Return the file and the name of the only policy."""
        policies = [found["name"] for found in self._report["policies"] if self.policy in (None, found["name"])]
        if len(self.paths) != 1 or len(policies) != 1:
            found = f"{len(self.paths)} files with the policies {', '.join(policies) or 'none'}"
            raise EvaluationError(
                f"{self!r} has {found}; a comparison needs one file on each side and one policy in it: Results(path, "
                "policy=NAME), or `hypogeum compare` for more"
            )
        return self.paths[0], policies[0]

    def _call(self, *words: str | os.PathLike[str]) -> str:
        return call(find_program(self._program), words)


def cell(found: dict[str, Any]) -> Cell:
    """Return a cell of the program's report."""
    n, successes = found["n"], found["successes"]
    low, high = found["interval"] or (0.0, 1.0)
    names = {key: found[key] for key in ("policy", "task", "perturbation", "n", "successes", "errors")}
    return Cell(**names, rate=successes / n if n else float("nan"), low=low, high=high)


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Return the episodes in a results file or package that the program has checked."""
    if is_zipfile(path):
        with ZipFile(path) as package, TemporaryDirectory(prefix="hypogeum-") as folder:
            return [row | {"file": str(path)} for row in read_rows(Path(package.extract("results.db", folder)))]
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
            described = connection.execute("SELECT name FROM pragma_table_info('episodes')")
            names = [name for (name,) in described if name not in INTERNAL]
            query = f"SELECT {', '.join(names)} FROM episodes ORDER BY {', '.join(KEY)}"
            rows = [dict(zip(names, row)) for row in connection.execute(query)]
    except sqlite3.Error as error:
        raise EvaluationError(f"{path} cannot be read: {error}") from error
    for row in rows:
        row["success_once"], row["success_at_end"] = bool(row["success_once"]), bool(row["success_at_end"])
        row["file"] = str(path)
    return rows


def table_rows(cells: Sequence[Cell]) -> list[list[str]]:
    """Return the table of cells, with its head, as texts of equal widths per column."""
    rows = [["policy", "task", "perturbation", "n", "success", "95 % interval", "errors"]]
    for cell in cells:
        interval = f"{100 * cell.low:.1f} – {100 * cell.high:.1f} %"
        numbers = [str(cell.n), f"{100 * cell.rate:.1f} %", interval, str(cell.errors)]
        rows.append([cell.policy, cell.task, cell.perturbation, *numbers])
    columns = [[text.ljust(max(map(len, column))) for text in column] for column in zip(*rows)]
    return list(map(list, zip(*columns)))
