"""Evaluation of policies by `hypogeum run`, also of one that lives in this process."""

from __future__ import annotations

import json
import os
import sqlite3
import subprocess
import sys
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, closing, nullcontext, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any

from .program import EvaluationError, find_program, message
from .results import Results

# Time between two looks for the run, which needs a fraction of a second to start.
POLL_INTERVAL_S = 0.02
# Time in which a run that has been asked to end does so; it waits four seconds for its own children.
END_S = 20.0
# Lines of the program's standard error that are remembered for its error message.
MAX_LINES = 100
# Exit codes with which a run has done its work: all of it, or all but episodes that ended with an error.
DONE = (0, 1)
ATTACH = "attach:"


def evaluate(
    policy: Any,
    tasks: str | Sequence[str] = "all",
    perturbations: str | Sequence[str] = "none",
    episodes: int = 10,
    *,
    name: str = "policy",
    seed: int = 0,
    execute: int | None = None,
    mode: str | None = None,
    protocol: str | None = None,
    control_mode: str | None = None,
    db: str | os.PathLike[str] | None = None,
    options: Sequence[str] = (),
    quiet: bool = False,
    program: str | os.PathLike[str] | None = None,
) -> Results:
    """Evaluate a policy in the simulator: the episodes, and the bits, of `hypogeum run`.

    A policy in this process is served in the calling thread: it reads observations in shared memory, many episodes at
    a time. If it raises, the run is ended and the exception goes on to the caller; so does Ctrl-C. If this process is
    killed, the run ends by itself. An action that is not finite ends only its own episode, with an error.

    Args:
        policy: One of
            - a spec as of `run --policy`, such as `"act:PATH"` or `"expert"`;
            - a function as for `hypogeum.serve`: it receives an `Observation` of `n_envs` envs and returns one chunk
              per env, `[n_envs, n_rows, action_dim]` or a list of `[n_rows, action_dim]`, as arrays or tensors;
            - a policy of LeRobot, or a tuple of it, its preprocessor and its postprocessor. A copy is evaluated, which
              is saved to a temporary folder and loaded from there (see `hypogeum.lerobot.live.copy_of`).
        tasks: Names of tasks, or `"all"`, `"single"` or `"bimanual"`.
        perturbations: Names of perturbations, also several joined by `+` that act together, or `"all"` that apply.
        episodes: Episodes per task and perturbation.
        name: Name of the policy in the results.
        seed: Suite seed, from which the seeds of all episodes are derived.
        execute: Rows of each chunk to execute before the next query. The default is that of the checkpoint of a spec,
            and 30 for other policies.
        mode: `"chunk"` or `"ensemble"`.
        protocol: `"act"` or `"lerobot"`.
        control_mode: Control mode of single-arm policies.
        db: Results file to create or to resume; the caller vouches that a policy in this process is the same as
            before. By default, a temporary file that lasts as long as the returned object.
        options: Further words for the command line, such as `("--threads", "4")`.
        quiet: Whether to show no progress. Otherwise, it goes to `sys.stderr`.
        program: Path of the program, if it is not found by itself (see `hypogeum.program.find_program`).

    Returns:
        `Results` of this policy, also if some episodes ended with an error.

    Raises:
        EvaluationError: The program is missing or refused the work.
        Exception: Whatever the policy raised. `AnswerError` says that its answer has a wrong shape or type,
            `RunRefused` and `MappingError` that a policy of LeRobot does not fit the run.
    """
    program = find_program(program)
    folder = TemporaryDirectory(prefix="hypogeum-") if db is None else None
    path = Path(folder.name, "results.db") if folder is not None else Path(os.fspath(db or ""))
    function, guard = (None, nullcontext()) if isinstance(policy, str) else as_function(policy)
    spec = policy if function is None else stored_spec(path, name) or f"{ATTACH}python-{uuid.uuid4().hex}"
    words = ["--policy", f"{name}={spec}", "--tasks", joined(tasks), "--perturbations", joined(perturbations)]
    words += ["--episodes", str(episodes), "--seed", str(seed), "--db", str(path)]
    flags = {"--execute": execute, "--mode": mode, "--protocol": protocol, "--control-mode": control_mode}
    words += [word for flag, value in flags.items() if value is not None for word in (flag, str(value))]
    with guard, _Run([program, "run", *words, *options, "--end-with-stdin"], quiet) as run:
        if function is not None:
            run.serve(function, spec.removeprefix(ATTACH))
        run.finish()
    return Results(path, policy=name, program=program, folder=folder)


class _Run:
    """A `hypogeum run` in a child process. It ends when this object is closed, or when this process ends."""

    def __init__(self, command: Sequence[str], quiet: bool) -> None:
        self.quiet = quiet
        self.lines: deque[str] = deque(maxlen=MAX_LINES)
        # In a session of its own, it does not see the terminal's Ctrl-C: this process ends it.
        self.child = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            errors="replace", start_new_session=True,
        )  # fmt: skip
        self.reader = threading.Thread(target=self._read, name="hypogeum run", daemon=True)
        self.reader.start()

    def __enter__(self) -> _Run:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self.child.stdin is not None
        self.child.stdin.close()
        try:
            self.child.wait(END_S)
        except subprocess.TimeoutExpired:
            self.child.kill()
            self.child.wait()
        self.reader.join(END_S)

    def serve(self, function: Callable[..., Any], name: str) -> None:
        """Answer the queries of the run with `function` until it ends."""
        from .endpoint import EndpointTimeout, base_folder, find_endpoint
        from .ensemble import DEFAULT_COEFF
        from .host import serve

        coeff = getattr(function, "ensemble_coeff", DEFAULT_COEFF)
        # A run whose shared memory is damaged goes on under another name, and is served once more.
        while self.child.poll() is None:
            if find_endpoint(name, base_folder()) is None:
                time.sleep(POLL_INTERVAL_S)
                continue
            try:
                serve(function, name, timeout_s=0, on_error="raise", ensemble_coeff=coeff)
            except EndpointTimeout:
                # The run has ended meanwhile.
                continue

    def finish(self) -> None:
        """Wait until the run has ended.

        Raises:
            EvaluationError: It has not done its work.
        """
        code = self.child.wait()
        self.reader.join(END_S)
        if code not in DONE:
            raise EvaluationError(message(self.lines, code))

    def _read(self) -> None:
        assert self.child.stderr is not None
        with self.child.stderr as lines:
            for line in lines:
                self.lines.append(line)
                if not self.quiet:
                    # The run must not wait for a reader, even if nobody can see its progress any more.
                    with suppress(OSError, ValueError):
                        sys.stderr.write(line)
                        sys.stderr.flush()


def as_function(policy: Any) -> tuple[Callable[..., Any], AbstractContextManager[Any]]:
    """Return the policy function of a policy in this process, and a context in which to call it.

    Raises:
        TypeError: It is none of those that `evaluate` takes.
    """
    first, *processors = policy if isinstance(policy, tuple) else (policy,)
    # Whoever has a policy of LeRobot has imported its class.
    base = getattr(sys.modules.get("lerobot.policies.pretrained"), "PreTrainedPolicy", None)
    if base is not None and isinstance(first, base):
        from .lerobot.live import copy_of, keep_random_state

        with keep_random_state():
            return copy_of(first, *processors), keep_random_state()
    if isinstance(policy, tuple) or not callable(policy):
        raise TypeError(
            f"the policy is of type {type(first).__name__}, expected a spec, a function of an observation, or a policy "
            "of LeRobot with its preprocessor and postprocessor"
        )
    return policy, nullcontext()


def stored_spec(path: Path, name: str) -> str | None:
    """Return the spec of a policy of an earlier process in a results file that exists, by which it is known there."""
    if not path.is_file():
        return None
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
            found = connection.execute("SELECT value FROM manifest WHERE key = ?", (f"policy/{name}",)).fetchone()
            spec = json.loads(found[0])["spec"] if found else None
    # The program says what is wrong with the file.
    except (sqlite3.Error, ValueError, KeyError, TypeError):
        return None
    return spec if isinstance(spec, str) and spec.startswith(ATTACH) else None


def joined(names: str | Sequence[str]) -> str:
    """Return names as the command line takes them."""
    return names if isinstance(names, str) else ",".join(names)
