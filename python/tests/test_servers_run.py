"""Runs whose policy is in a server, compared with the same policy attached directly. Set HYPOGEUM to the binary."""

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("websockets")
pytest.importorskip("msgpack")

from policy_servers import OpenPiServer, VlaEvalServer, model_server, openpi_policy, served, vla_eval_policy

HYPOGEUM = os.environ.get("HYPOGEUM")
pytestmark = pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")

HERE = Path(__file__).parent
LIMIT_S = 120
COLUMNS = "task, episode, steps, success_once, success_at_end, first_success_step, failed_predicate, fingerprint, error"
DIRECT = "import policy_servers, hypogeum; print(hypogeum.serve(policy_servers.direct, 'mine', timeout_s=30))"
MAPPING = """{"mapping": {"observation/image": "external1", "observation/state": ["qpos[0:8]"], "prompt": "instruction"}}"""


class Trial:
    """A run of ten episodes in a temporary folder, and its hosts."""

    def __init__(self, *options, policy="p=attach:mine", episodes=10):
        self.dir = Path(tempfile.mkdtemp(prefix="hyp"))
        (self.dir / "mapping.json").write_text(MAPPING)
        paths = os.pathsep.join([str(HERE), str(HERE.parent), *sys.path])
        self.env = {**os.environ, "XDG_RUNTIME_DIR": str(self.dir), "PYTHONPATH": paths}
        self.children = []
        line = ["run", "--policy", policy, "--tasks", "RaiseCube", "--episodes", str(episodes), *options]
        self.process = self.start([HYPOGEUM, *line, "--db", "r.db"])

    def start(self, line):
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        child = subprocess.Popen(line, cwd=self.dir, env=self.env, **pipes)
        self.children.append(child)
        return child

    def host(self, *arguments):
        return self.start([sys.executable, *map(str, arguments)])

    def rows(self):
        with sqlite3.connect(self.dir / "r.db") as results:
            return results.execute(f"select {COLUMNS} from episodes order by task, episode").fetchall()

    def close(self):
        for child in self.children:
            child.kill()
            child.communicate()
        shutil.rmtree(self.dir)


@contextmanager
def trial(*options, **kwargs):
    run = Trial(*options, **kwargs)
    try:
        yield run
    finally:
        run.close()


def finish(child):
    """Wait for a process and return its exit code, standard output and standard error."""
    out, err = child.communicate(timeout=LIMIT_S)
    return child.returncode, out, err


@pytest.fixture(scope="module")
def direct():
    """Rows of the policy that is attached directly."""
    with trial("--execute", "10") as run:
        host = run.host("-c", DIRECT)
        code, _, err = finish(run.process)
        assert code == 0, err
        assert finish(host)[0] == 0
        rows = run.rows()
    assert len(rows) == 10 and len({row[7] for row in rows}) == 10 and all(row[8] is None for row in rows)
    return rows


def attached(module, port, *arguments, options=("--execute", "10")):
    """Return the rows of a run whose policy a module of the package asks for."""
    with trial(*options) as run:
        host = run.host("-m", f"hypogeum.{module}", f"ws://127.0.0.1:{port}", "mine", "--timeout", "30", *arguments)
        code, _, err = finish(run.process)
        assert code == 0, err + finish(host)[2]
        code, out, err = finish(host)
        assert code == 0 and "failed=0" in out and "connected to ws://127.0.0.1" in err, err
        return run.rows()


def test_openpi_gives_the_same_rows(direct):
    with served(server := OpenPiServer(openpi_policy)) as port:
        assert attached("openpi", port, "--mapping", "mapping.json") == direct
    assert server.n_connections == 8 and server.n_requests >= 50


def test_vla_eval_gives_the_same_rows(direct):
    with served(VlaEvalServer(vla_eval_policy)) as port:
        assert attached("vla_eval", port) == direct


@pytest.mark.parametrize("chunk_size, execute, batch", [(None, "10", 1), (None, "10", 4), (10, "1", 1)])
def test_model_server_gives_the_same_rows(direct, chunk_size, execute, batch):
    pytest.importorskip("vla_eval")
    with model_server(chunk_size=chunk_size, max_batch_size=batch) as server:
        assert attached("vla_eval", server.port, options=("--execute", execute)) == direct


def test_lost_connection_costs_only_its_episodes(direct):
    def behaviour(number, request):
        return "close" if number == 20 else openpi_policy(number, request)

    with served(OpenPiServer(behaviour)) as port, trial("--execute", "10") as run:
        host = run.host("-m", "hypogeum.openpi", f"ws://127.0.0.1:{port}", "mine", "--mapping", "mapping.json")
        assert finish(run.process)[0] == 1
        code, out, err = finish(host)
        assert code == 0 and "failed=1" in out
        assert err.count("closed the connection (") == 1 and "a new connection is opened" in err
        assert "keep copies" not in err
        rows = run.rows()
    lost = [row for row in rows if row[8] is not None]
    assert 0 < len(lost) < 10 and {row[8] for row in lost} == {"the policy host could not answer; see its log"}
    assert all(row in direct for row in rows if row[8] is None)


def test_killed_host_is_replaced_without_a_trace(direct):
    with served(server := OpenPiServer(openpi_policy)) as port, trial("--execute", "10") as run:
        line = ["-m", "hypogeum.openpi", f"ws://127.0.0.1:{port}", "mine", "--mapping", "mapping.json"]
        first = run.host(*line)
        while server.n_requests < 10 and first.poll() is None:
            time.sleep(0.01)
        first.kill()
        first.communicate()
        second = run.host(*line)
        code, _, err = finish(run.process)
        assert code == 0 and finish(second)[0] == 0, err
        assert run.rows() == direct


def started(port, module, query, python=sys.executable, options=()):
    """Return a run that starts the module itself, after it has ended: exit code, standard error and rows."""
    spec = f"p={module}:ws://user:secret@127.0.0.1:{port}{query}"
    with trial("--execute", "10", "--python", python, *options, policy=spec) as run:
        code, _, err = finish(run.process)
        has_rows = (run.dir / "r.db").exists()
        assert not list((run.dir / "hypogeum").glob("*/attach"))
        assert not has_rows or b"secret" not in (run.dir / "r.db").read_bytes()
        return code, err, run.rows() if has_rows else []


@pytest.mark.parametrize(
    "module, query, server",
    [("openpi", "?mapping=mapping.json", OpenPiServer(openpi_policy)), ("vla-eval", "", VlaEvalServer(vla_eval_policy))],
)
def test_run_starts_the_module_itself(direct, module, query, server):
    with served(server) as port:
        code, err, rows = started(port, module, query)
    assert code == 0, err
    assert rows == direct and "secret" not in err
    assert "the server says of itself: {'" in err


def test_missing_parts_are_told_before_the_run(tmp_path):
    (tmp_path / "mapping.json").write_text(MAPPING)
    query = f"?mapping={tmp_path / 'mapping.json'}"
    with served(OpenPiServer(openpi_policy)) as port:
        cases = [
            (dict(query=query, python="no-python"), "failed to start no-python; choose a Python interpreter with --python"),
            (dict(query=query, python=bare_python(tmp_path)), "has no module hypogeum.openpi: install the package"),
            (dict(query=""), "openpi's servers expect the keys that their checkpoint was trained with"),
            (dict(query="?mapping=none.json"), "none.json"),
            (dict(query="?map=x"), "policy `openpi` knows the options mapping, connections, checkpoint, type, device"),
        ]
        for arguments, words in cases:
            code, err, rows = started(port, "openpi", **arguments)
            assert (code, rows) == (2, []) and words in err, err
    code, err, _ = started(1, "vla-eval", "")
    assert code == 2 and "ws://127.0.0.1:1 cannot be reached" in err, err


def bare_python(folder):
    """Return an interpreter without packages."""
    (path := folder / "python").write_text(f'#!/bin/sh\nunset PYTHONPATH\nexec {sys.executable} -I -S "$@"\n')
    path.chmod(0o755)
    return str(path)


def test_server_that_ends_ends_the_run():
    server = OpenPiServer(openpi_policy)
    with served(server) as port:
        spec = f"p=openpi:ws://127.0.0.1:{port}?mapping=mapping.json"
        run = Trial("--execute", "1", "--python", sys.executable, policy=spec, episodes=1000)
        while server.n_requests < 100 and run.process.poll() is None:
            time.sleep(0.01)
    try:
        # The module waits for the server until the run would give it up; a stop ends both at once.
        run.process.send_signal(signal.SIGINT)
        start = time.monotonic()
        code, _, err = finish(run.process)
        assert code == 130 and time.monotonic() - start < 10, err
        found = subprocess.run(["pgrep", "-f", f"127.0.0.1:{port}"], capture_output=True, text=True, check=False)
        assert found.stdout == ""
    finally:
        run.close()
