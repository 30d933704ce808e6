"""Sweeps over SSH: two hosts without a common folder, and one that does not answer."""

import subprocess
from pathlib import Path

import pytest

import ssh_server
from ssh_server import SshHosts
from sweep import OPTIONS, PROGRAM, Rows, Sweep, assert_equal

pytestmark = pytest.mark.skipif(ssh_server.why_not() is not None, reason=ssh_server.why_not() or "")

TIMEOUT_S = 120.0


def submission(hosts: SshHosts, names: str) -> list[str]:
    options = ["--shards", "4", "--hosts", names, "--ssh", hosts.options]
    return ["submit", "ssh", "sweep.toml", *options, "--", *OPTIONS, "--threads", "1"]


def test_two_hosts_equal_one_run(sweep: Sweep, undisturbed: Rows, tmp_path: Path) -> None:
    with SshHosts(tmp_path / "hosts", ["alpha", "beta"]) as hosts:
        sweep.hypogeum(*submission(hosts, "alpha,beta"), timeout_s=TIMEOUT_S)
        assert_equal(sweep.rows(), undisturbed)
        for home in hosts.homes.values():
            assert list(home.rglob("shard-*.db")), f"{home.name} has run nothing"


def test_unreachable_host_leaves_its_work(sweep: Sweep, undisturbed: Rows, tmp_path: Path) -> None:
    with SshHosts(tmp_path / "hosts", ["alpha"], unreachable=["gamma"]) as hosts:
        command = ["env", f"--chdir={sweep.folder}", str(PROGRAM), *submission(hosts, "alpha,gamma")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, stdin=subprocess.DEVNULL)
        assert done.returncode == 0 and "gamma" in done.stderr, done.stdout + done.stderr
        assert_equal(sweep.rows(), undisturbed)
