"""Serving of real runs. Set HYPOGEUM to the `hypogeum` binary."""

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

HYPOGEUM = os.environ.get("HYPOGEUM")
pytestmark = pytest.mark.skipif(not HYPOGEUM, reason="HYPOGEUM is not set to the binary")

# A run of a few episodes takes a second or two.
LIMIT_S = 30
HOST = """
import glob, os, signal, sys, time
import numpy as np, hypogeum
calls = 0
def overwrite(observation):
    state = observation[0].state.tobytes()
    for path in glob.glob("/dev/shm/hyp_*.data"):
        with open(path, "r+b") as segment:
            at = segment.read().find(state)
            if at >= 0:
                segment.seek(at)
                segment.write(bytes(len(state)))
def fn(observation):
    global calls
    calls += 1
    chunk = np.zeros((observation.n_envs, 10, observation.action_dim))
    {body}
    return chunk
print(hypogeum.serve(fn, "mine", timeout_s=30, on_error={on_error!r}))
"""


class Run:
    """A run with one foreign policy host, in a temporary folder whose path is short enough for sockets."""

    def __init__(self, episodes=3, policies=()):
        self.dir = Path(tempfile.mkdtemp(prefix="hyp"))
        self.children = []
        self.env = {**os.environ, "XDG_RUNTIME_DIR": str(self.dir)}
        args = ["run", "--policy", "p=attach:mine", "--tasks", "RaiseCube", "--episodes", str(episodes), "--db", "r.db"]
        args.append("--check-frames")
        args += [word for policy in policies for word in ("--policy", policy)]
        self.process = self.start([HYPOGEUM, *args])

    def start(self, command):
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        child = subprocess.Popen(command, cwd=self.dir, env=self.env, **pipes)
        self.children.append(child)
        return child

    def host(self, body="", on_error="report"):
        return self.start([sys.executable, "-c", HOST.format(body=body, on_error=on_error)])

    def sim(self):
        """Wait for the simulator to start and return its process id."""
        for _ in range(100):
            found = subprocess.run(["pgrep", "-P", str(self.process.pid)], capture_output=True, text=True, check=False)
            if found.stdout.strip():
                return int(found.stdout.split()[0])
            time.sleep(0.05)
        raise AssertionError("the run has not started a simulator")

    def errors(self):
        """Return the error of every episode in the results."""
        with sqlite3.connect(self.dir / "r.db") as results:
            return [error for (error,) in results.execute("select error from episodes order by episode")]

    def prefixes(self):
        """Return the prefixes of this run's shared memory segments."""
        return [f"hyp_{os.getuid()}_{run.name}_" for run in (self.dir / "hypogeum").glob("*")]

    def close(self):
        for child in self.children:
            child.kill()
            child.communicate()
        shutil.rmtree(self.dir)


@pytest.fixture
def run():
    before = set(os.listdir("/dev/shm"))
    run = Run()
    yield run
    leftover = run.prefixes()
    run.close()
    assert leftover == [], "the run's folder was not removed"
    assert not [name for name in set(os.listdir("/dev/shm")) - before if name.startswith(tuple(leftover or ["\0"]))]


def finish(child):
    """Wait for a process and return its exit code, standard output and standard error."""
    out, err = child.communicate(timeout=LIMIT_S)
    return child.returncode, out, err


def test_every_episode_is_completed(run):
    host = run.host()
    code, _, err = finish(run.process)
    assert code == 0, err
    code, out, err = finish(host)
    assert code == 0 and "failed=0" in out and err == ""
    assert run.errors() == [None] * 3


@pytest.mark.parametrize(
    "body, words",
    [
        ("chunk = chunk[:, :, :6]", "expected [n_rows, action_dim=7]"),
        ("raise RuntimeError('no weights')", "RuntimeError: no weights"),
        ("chunk[:, 3, 2] = np.nan", ""),
    ],
)
def test_invalid_answer_ends_episodes_with_error(run, body, words):
    host = run.host(body)
    code, _, err = finish(run.process)
    assert code == 1, err
    assert len(run.errors()) == 3 and all(run.errors())
    code, _, err = finish(host)
    assert code == 0 and words in err


def test_episodes_of_overwritten_observation_run_again(run):
    host = run.host("if calls == 2: overwrite(observation)")
    code, _, err = finish(run.process)
    assert code == 0 and "overwritten in shared memory" in err
    assert run.errors() == [None] * 3
    code, out, err = finish(host)
    assert code == 0 and "failed=1" in out and "the episodes in it run again" in err


def test_killed_host_can_be_replaced(run):
    first = run.host("if calls == 2: os.kill(os.getpid(), signal.SIGKILL)")
    assert finish(first)[0] == -signal.SIGKILL
    second = run.host()
    assert finish(run.process)[0] == 0 and run.errors() == [None] * 3
    assert finish(second)[0] == 0


def test_lane_is_free_after_host_raises(run):
    first = run.host("if calls == 2: raise KeyError('camera')", on_error="raise")
    code, _, err = finish(first)
    assert code == 1 and "KeyError: 'camera'" in err
    # The episodes of the first host's last message end with an error, however soon the simulator notices that
    # the host is gone; the second host serves any others.
    run.host()
    assert finish(run.process)[0] == 1
    errors = run.errors()
    assert len(errors) == 3 and any(errors)
    assert all(error is None or "could not answer" in error for error in errors), errors


def test_hosts_that_keep_leaving_cost_only_their_episodes():
    run = Run(policies=["expert"])
    try:
        while run.process.poll() is None:
            host = run.host("if calls == 2: os.kill(os.getpid(), signal.SIGKILL)")
            # A host that comes as the run ends would wait for another one.
            while host.poll() is None and run.process.poll() is None:
                time.sleep(0.05)
            host.kill()
            host.communicate()
        code, _, err = finish(run.process)
        assert code == 1 and "gave up policy `p`" in err, err
        errors = run.errors()
        assert sorted(error is None for error in errors) == [False] * 3 + [True] * 3
        assert {error for error in errors if error} == {
            "the policy was given up: 10 hosts of policy `p` left without finishing an episode"
        }
    finally:
        run.close()


def test_restarted_sim_reconnects_to_its_host(run):
    host = run.host("time.sleep(0.3)")
    time.sleep(1.5)
    os.kill(run.sim(), signal.SIGKILL)
    code, _, err = finish(run.process)
    assert code == 0 and "restarting it" in err, err
    assert run.errors() == [None] * 3
    assert finish(host)[0] == 0


def test_interrupted_host_detaches_at_once(run):
    host = run.host("time.sleep(10)")
    time.sleep(1.5)
    host.send_signal(signal.SIGINT)
    code, _, err = finish(host)
    assert code != 0 and "KeyboardInterrupt" in err
    second = run.host()
    assert finish(run.process)[0] == 0 and finish(second)[0] == 0


def test_retained_array_is_reported_and_harmless(run):
    host = run.host("global kept; kept = globals().get('kept', []) + [observation.external]; assert kept[0].max() > 0")
    assert finish(run.process)[0] == 0
    code, out, err = finish(host)
    assert code == 0 and "failed=0" in out and "keep copies" in err
