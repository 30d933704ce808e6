"""Explanations of missing packages. Imports nothing but the standard library."""

import platform
import sys
from contextlib import contextmanager

FFMPEG = (
    "torchcodec cannot load the libraries of FFmpeg; install FFmpeg 4 to 8 (Debian and Ubuntu: apt install ffmpeg; "
    "conda: conda install -c conda-forge ffmpeg)"
)


@contextmanager
def explained(command):
    """Exit with one sentence if a package that the code within needs is missing or cannot be loaded.

    Args:
        command: Command that installs everything needed.
    """
    try:
        yield
    except (ImportError, RuntimeError) as error:
        explanation = explain(error, command)
        if explanation is None:
            raise
        sys.exit(f"error: {explanation}")


def explain(error: BaseException, command: str) -> str | None:
    """Return one sentence that says what to install, or None if nothing is missing."""
    # The name of the library in torchcodec's message, which appears whatever the type of its exception is.
    if "libtorchcodec" in str(error):
        return FFMPEG
    if not isinstance(error, ImportError):
        return None
    reason = str(error).split("\n", maxsplit=1)[0]
    version = f" (LeRobot 0.6 needs Python 3.12 or newer, this is {platform.python_version()})"
    return f"{reason}; install what is missing: {command}{version if 'lerobot' in command else ''}"
