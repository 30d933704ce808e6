"""A server of SSH on 127.0.0.1 that plays several hosts, each with a port and a home of its own.

It has its own keys and configuration, in a temporary folder, and lets nobody in but the test.
"""

import getpass
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from waiting import free_ports, output_of, stop_all_with, wait_for

SERVER = "/usr/sbin/sshd"
PROGRAMS = ("ssh", "ssh-keygen", "rsync")
# Folder that a server of root demands. It stays empty.
PRIVILEGE_SEPARATION = Path("/run/sshd")
START_S = 10.0
# Entry in the environment of all processes of the hosts.
MARK = "HYPOGEUM_TEST_SSH"

SERVER_CONFIGURATION = """\
ListenAddress 127.0.0.1
HostKey {folder}/host_key
AuthorizedKeysFile {folder}/user_key.pub
PidFile none
StrictModes no
UsePAM no
PasswordAuthentication no
KbdInteractiveAuthentication no
PermitRootLogin prohibit-password
"""
HOST_OF_SERVER = """\
Match LocalPort {port}
    ForceCommand {folder}/login {home}
"""
# The login shell of a host: its home is the one of the host.
LOGIN = """\
#!/bin/sh
cd "$1" || exit 1
HOME=$1 {mark}={folder} exec sh -c "$SSH_ORIGINAL_COMMAND"
"""
CLIENT_CONFIGURATION = """\
Host *
    HostName 127.0.0.1
    User {user}
    IdentityFile {folder}/user_key
    IdentitiesOnly yes
    UserKnownHostsFile {folder}/known_hosts
    BatchMode yes
"""


def why_not() -> str | None:
    """Returns the reason why this machine cannot be a server, if there is one."""
    missing = [name for name in (SERVER, *PROGRAMS) if not shutil.which(name)]
    return f"{', '.join(missing)} missing: install openssh-server and rsync" if missing else None


class SshHosts:
    """Hosts as a context manager; `options` are for the `ssh` that shall reach them."""

    def __init__(self, folder: Path, reachable: Sequence[str], unreachable: Sequence[str] = ()):
        self.folder = folder
        self.homes = {host: folder / host for host in reachable}
        self.unreachable = unreachable
        self.options = f"-F {folder}/config"

    def __enter__(self) -> "SshHosts":
        for home in self.homes.values():
            home.mkdir(parents=True)
        for key in ("host_key", "user_key"):
            output_of(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(self.folder / key)])
        login = self.folder / "login"
        login.write_text(LOGIN.format(folder=self.folder, mark=MARK))
        login.chmod(0o700)
        ports = free_ports(len(self.homes) + len(self.unreachable))
        self._configure(dict(zip([*self.homes, *self.unreachable], ports)))
        self.made_folder = os.geteuid() == 0 and not PRIVILEGE_SEPARATION.exists()
        if self.made_folder:
            PRIVILEGE_SEPARATION.mkdir(mode=0o755)
        with (self.folder / "sshd.log").open("wb") as log:
            command = [SERVER, "-D", "-e", "-f", str(self.folder / "sshd_config")]
            self.server = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        try:
            wait_for("sshd", lambda: all(map(self._answers, self.homes)), START_S)
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop()

    def _configure(self, ports: dict[str, int]) -> None:
        """Writes the files of server and client. Nobody listens on the ports of the unreachable hosts."""
        host_key = (self.folder / "host_key.pub").read_text()
        server = "".join(f"Port {ports[host]}\n" for host in self.homes)
        server += SERVER_CONFIGURATION.format(folder=self.folder)
        for host, home in self.homes.items():
            server += HOST_OF_SERVER.format(port=ports[host], folder=self.folder, home=home)
        client = "".join(f"Host {host}\n    Port {port}\n" for host, port in ports.items())
        client += CLIENT_CONFIGURATION.format(folder=self.folder, user=getpass.getuser())
        known = "".join(f"[127.0.0.1]:{port} {host_key}" for port in ports.values())
        for name, text in (("sshd_config", server), ("config", client), ("known_hosts", known)):
            (self.folder / name).write_text(text)

    def _answers(self, host: str) -> bool:
        assert self.server.poll() is None, (self.folder / "sshd.log").read_text()
        command = ["ssh", "-F", str(self.folder / "config"), host, "true"]
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=START_S)
        return done.returncode == 0

    def _stop(self) -> None:
        self.server.terminate()
        self.server.wait(timeout=START_S)
        stop_all_with(f"{MARK}={self.folder}")
        if self.made_folder:
            PRIVILEGE_SEPARATION.rmdir()
