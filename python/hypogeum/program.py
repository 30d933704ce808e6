"""The program `hypogeum`: where it is, and calls that return its output."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Sequence

NAME = "hypogeum"
# Environment variable that names the program.
VARIABLE = "HYPOGEUM"
# What clap adds to the message about a wrong argument.
ADVICE = "For more information, try"


class EvaluationError(Exception):
    """An evaluation that failed: the program is missing, or it refused the work; its message says why."""


def find_program(program: str | os.PathLike[str] | None = None) -> str:
    """Return the path of the program.

    The first of these counts: `program`, the environment variable HYPOGEUM, a program in the folder of this Python or
    of its scripts, and one in PATH.

    Raises:
        EvaluationError: There is none, or the one named does not exist.
    """
    for origin, named in (("program", program), (VARIABLE, os.environ.get(VARIABLE))):
        if named:
            found = shutil.which(os.fspath(named))
            if found is None:
                raise EvaluationError(f"{origin} is {os.fspath(named)!r}, which is no program that can be executed")
            return found
    beside = [os.path.dirname(sys.executable), sysconfig.get_path("scripts")]
    found = shutil.which(NAME, path=os.pathsep.join(beside)) or shutil.which(NAME)
    if found is None:
        raise EvaluationError(
            f"there is no program {NAME!r} beside {sys.executable} or in PATH; `pip install ./python` brings it, or build "
            f"it with `cargo build --release` and set {VARIABLE} to target/release/hypogeum, or pass `program`"
        )
    return found


def call(program: str, words: Sequence[str | os.PathLike[str]]) -> str:
    """Run the program and return its standard output.

    Raises:
        EvaluationError: The program failed.
    """
    done = subprocess.run(
        [program, *words], stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", check=False
    )
    if done.returncode != 0:
        raise EvaluationError(message(done.stderr.splitlines(), done.returncode))
    return done.stdout


def message(lines: Iterable[str], code: int) -> str:
    """Return the message with which the program ended, from the lines of its standard error and its exit code."""
    kept = [line.rstrip() for line in lines if line.strip() and not line.startswith(ADVICE)]
    first = max((idx for idx, line in enumerate(kept) if line.startswith("error: ")), default=len(kept) - 1)
    said = "\n".join(kept[max(first, 0) :]).removeprefix("error: ")
    return said or f"{NAME} ended with exit code {code}"
