"""A virtual Slurm cluster: four nodes on this host, in a temporary folder, with an authentication service of its own.

Slurm runs here as root, without systemd and without control groups. Nothing outside the folder is changed.
"""

import os
import secrets
import shutil
import socket
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

from waiting import free_ports, output_of, processes_with, stop_all_with, wait_for

NODES = ("n1", "n2", "n3", "n4")
PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "scontrol", "squeue", "sinfo", "scancel")
START_S = 30.0
KEY_BYTES = 128
SYSTEM_FOLDERS = "/usr/sbin:/sbin"

CONFIGURATION = """\
ClusterName=virtual
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmctldPort={control_port}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CryptoType=crypto/munge
MailProg=/bin/true
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SlurmdParameters=config_overrides
SchedulerParameters=batch_sched_delay=1,sched_interval=2,bf_interval=2,requeue_setup_env_fail
ReturnToService=2
KillWait=10
PreemptMode=REQUEUE
PreemptType=preempt/partition_prio
NodeName=n[1-4] NodeHostname={host} NodeAddr=127.0.0.1 Port=[{first_port}-{last_port}] CPUs=1 RealMemory=2000
PartitionName=low Nodes=ALL Default=YES PriorityTier=1 MaxTime=60
PartitionName=high Nodes=ALL PriorityTier=10 MaxTime=60
"""


def why_not() -> str | None:
    """Returns the reason why this machine cannot be a cluster, if there is one."""
    if os.geteuid() != 0:
        return "a virtual Slurm cluster needs root"
    missing = [name for name in PROGRAMS if not shutil.which(name, path=f"{os.environ['PATH']}:{SYSTEM_FOLDERS}")]
    return f"Slurm is not installed: {', '.join(missing)} missing" if missing else None


@dataclass
class SlurmCluster:
    """A cluster as a context manager. `environment` is that of its users."""

    folder: Path = field(init=False)
    environment: dict[str, str] = field(init=False)
    daemons: list[subprocess.Popen[bytes]] = field(init=False, default_factory=list)

    def __enter__(self) -> "SlurmCluster":
        # Munge wants each folder above its socket to be open to all, which those of pytest are not.
        self.folder = Path(tempfile.mkdtemp(prefix="slurm", dir="/tmp"))
        self.folder.chmod(0o755)
        path = f"{os.environ['PATH']}:{SYSTEM_FOLDERS}"
        self.environment = {**os.environ, "SLURM_CONF": str(self.folder / "slurm.conf"), "PATH": path}
        try:
            self._start()
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop()

    def _start(self) -> None:
        control_port, first_port, *_, last_port = free_ports(1 + len(NODES))
        values = {"control_port": control_port, "first_port": first_port, "last_port": last_port}
        host = socket.gethostname().split(".")[0]
        text = CONFIGURATION.format(host=host, folder=self.folder, **values)
        (self.folder / "slurm.conf").write_text(text)
        (self.folder / "state").mkdir()
        key = self.folder / "munge.key"
        key.touch(mode=0o600)
        key.write_bytes(secrets.token_bytes(KEY_BYTES))
        paths = {"socket": "munge.socket", "key-file": "munge.key", "log-file": "munged.log"}
        paths |= {"pid-file": "munged.pid", "seed-file": "munged.seed"}
        self._daemon("munged", "--foreground", *(f"--{name}={self.folder / file}" for name, file in paths.items()))
        wait_for("munged", (self.folder / "munge.socket").exists, START_S)
        self._daemon("slurmctld", "-D")
        for node in NODES:
            self._daemon("slurmd", "-D", "-N", node)
        wait_for("four idle nodes", lambda: self.node_states() == ["idle"] * len(NODES), START_S)

    def _daemon(self, *command: str) -> None:
        with (self.folder / f"{command[0]}-{len(self.daemons)}.out").open("wb") as output:
            process = subprocess.Popen(
                command, env=self.environment, stdin=subprocess.DEVNULL, stdout=output, stderr=output
            )
        self.daemons.append(process)

    def _stop(self) -> None:
        """Ends all jobs and daemons. Whoever carries this cluster's `SLURM_CONF` was started by it."""
        for daemon in reversed(self.daemons):
            daemon.terminate()
        for daemon in reversed(self.daemons):
            try:
                daemon.wait(timeout=10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait(timeout=10)
        stop_all_with(f"SLURM_CONF={self.environment['SLURM_CONF']}")
        shutil.rmtree(self.folder, ignore_errors=True)

    def command(self, *command: str, timeout_s: float = 30.0) -> str:
        """Runs a command of a user and returns its output."""
        return output_of(list(command), self.environment, timeout_s)

    def node_states(self) -> list[str]:
        """Returns the states of the nodes, none while the controller does not answer."""
        command = ["sinfo", "--noheader", "--Node", "--partition=low", "--format=%T"]
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=30)
        return done.stdout.split()

    def jobs(self) -> dict[str, dict[str, str]]:
        """Returns the jobs and tasks of arrays that the controller remembers, with their attributes."""
        jobs = {}
        for line in self.command("scontrol", "show", "job", "--oneliner").splitlines():
            if "=" not in line:
                continue
            attributes = dict(word.split("=", 1) for word in line.split() if "=" in word)
            name = attributes["JobId"]
            if "ArrayTaskId" in attributes:
                name = f"{attributes['ArrayJobId']}_{attributes['ArrayTaskId']}"
            jobs[name] = attributes
        return jobs

    def state(self, job: str) -> str:
        """Returns the state of a job or a task, such as `RUNNING`, or `GONE`."""
        return self.jobs().get(job, {}).get("JobState", "GONE")

    def task_processes(self, job: str | None = None) -> list[int]:
        """Returns the processes of all tasks, or of one job. Slurm's own have no job in their environment."""
        of_job = f"SLURM_JOB_ID={job}\0" if job else "SLURM_JOB_ID="
        return processes_with(f"SLURM_CONF={self.environment['SLURM_CONF']}", of_job)
