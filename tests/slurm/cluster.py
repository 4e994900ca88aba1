"""A private Slurm cluster on this machine: real daemons, in a folder and on ports of their own.

A system's Slurm and munge are neither used nor touched, and nothing is installed. All nodes share
this machine and there are no cgroups: memory is not limited, cores are not pinned, and timings
mean nothing.
"""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import tempfile
from pathlib import Path

from tools import wait_until

DAEMONS = ("munged", "slurmctld", "slurmd", "sbatch")

CONFIGURATION = """
ClusterName=test
SlurmctldHost={host}({address})
SlurmctldPort={port}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
CredType=cred/munge
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/backfill
SchedulerParameters=bf_interval=1,sched_interval=1,batch_sched_delay=0,sched_min_interval=100000
MpiDefault=none
SwitchType=switch/none
ReturnToService=2
JobRequeue=1
MaxArraySize={max_array_size}
KillWait=5
SlurmctldTimeout=10
SlurmdTimeout=6
InactiveLimit=0
Waittime=0
"""


def why_not() -> str | None:
    """Return why no cluster can be started here, or None."""
    if missing := [name for name in DAEMONS if shutil.which(name, path=_path()) is None]:
        return f"Slurm is not installed: no {', '.join(missing)}"
    if os.getuid() != 0:
        return "only root can start a private Slurm cluster"
    try:
        _address()
    except OSError:
        return f"the name of this machine, {socket.gethostname()}, has no address"
    return None


def _path() -> str:
    return f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"


def _address() -> str:
    """Return the address to which Slurm binds: that of the host name, whatever it is told."""
    return socket.gethostbyname(socket.gethostname().split(".")[0])


class Cluster:
    """Nodes n0, n1, ... of one core each; the last is in the partition ``apart`` alone."""

    def __init__(self, nodes: int = 3, max_array_size: int = 3) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="shear-sim-slurm-"))
        self.nodes = [f"n{number}" for number in range(nodes)]
        self.daemons: dict[str, subprocess.Popen[bytes]] = {}
        self.conf = self.folder / "slurm.conf"
        self.environment = {
            **{name: value for name, value in os.environ.items() if not name.startswith("SLURM")},
            "PATH": _path(),
            "SLURM_CONF": str(self.conf),
        }
        host, address = socket.gethostname().split(".")[0], _address()
        port, *ports = _free_ports(address, nodes + 1)
        lines = [
            CONFIGURATION.format(
                host=host,
                address=address,
                port=port,
                folder=self.folder,
                max_array_size=max_array_size,
            )
        ]
        for node, its_port in zip(self.nodes, ports, strict=True):
            (self.folder / f"spool-{node}").mkdir()
            lines.append(
                f"NodeName={node} NodeHostname={host} NodeAddr={address} Port={its_port} "
                "CPUs=1 RealMemory=8000 State=UNKNOWN"
            )
        lines += [
            f"PartitionName=main Nodes={','.join(self.nodes[:-1])} Default=YES State=UP",
            f"PartitionName=apart Nodes={self.nodes[-1]} State=UP",
        ]
        self.conf.write_text("\n".join(lines) + "\n")
        (self.folder / "state").mkdir()
        self.folder.chmod(0o755)

    def start(self) -> None:
        """Start all daemons and wait until every node takes jobs."""
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o600)
        options = ("key-file", "socket", "pid-file", "log-file", "seed-file")
        given = [f"--{option}={self.folder}/munge.{option.split('-')[0]}" for option in options]
        self._start("munged", "munged", "--foreground", *given)
        wait_until((self.folder / "munge.socket").exists)
        self._start("slurmctld", "slurmctld", "-D", "-f", str(self.conf))
        wait_until(lambda: self.ask("scontrol", "ping", check=False).endswith("UP"))
        for node in self.nodes:
            self.start_node(node)
        wait_until(self.idle, 60)

    def idle(self) -> bool:
        """Tell whether every node waits for jobs."""
        return set(self.ask("sinfo", "-h", "-N", "-o", "%T").split()) == {"idle"}

    def start_node(self, node: str) -> None:
        """Start the daemon of a node, also again."""
        self._start(node, "slurmd", "-D", "-f", str(self.conf), "-N", node, SLURMD_NODENAME=node)

    def kill_node(self, node: str) -> None:
        """Kill the daemon of a node; its jobs go on unseen: orphans."""
        daemon = self.daemons.pop(node)
        _signal(daemon.pid, signal.SIGKILL)
        daemon.wait()

    def kill_node_of(self, array: int | None) -> str | None:
        """Kill a node under a running task of an array, with all its jobs; return the node.

        A task may end while one looks for it: its processes are stopped, looked at, and go on if
        it had ended.
        """
        if not (node := self.running(array)):
            return None
        jobs = self.processes(node)
        for pid in jobs:
            _signal(pid, signal.SIGSTOP)
        if self.running(array, node):
            self.kill_node(node)
            for pid in jobs:
                _signal(pid, signal.SIGKILL)
            return node
        for pid in jobs:
            _signal(pid, signal.SIGCONT)
        return None

    def revive(self) -> None:
        """Start the daemons of killed nodes again, and let all nodes take jobs."""
        for node in self.nodes:
            if node not in self.daemons:
                self.start_node(node)
        wait_until(self._in_service, 60)

    def _in_service(self) -> bool:
        states = dict(
            line.split() for line in self.ask("sinfo", "-h", "-N", "-o", "%N %T").splitlines()
        )
        away = [node for node, state in states.items() if state.strip("*") in {"down", "drained"}]
        for node in away:
            self.ask("scontrol", "update", f"NodeName={node}", "State=RESUME", check=False)
        return not away

    def start_jobs(self, partition: str, *, may: bool) -> None:
        """Let jobs of a partition start, or wait."""
        state = "UP" if may else "DOWN"
        self.ask("scontrol", "update", f"PartitionName={partition}", f"State={state}")

    def give_up(self, node: str) -> None:
        """Declare a dead node dead, as the controller does by itself after a while.

        The answer to an old question would bring it back to service, but not if it is drained.
        """
        for state in ("DRAIN", "DOWN"):
            self.ask("scontrol", "update", f"NodeName={node}", f"State={state}", "Reason=dead")

    def processes(self, node: str | None = None) -> list[int]:
        """Return the processes of jobs of this cluster, or of one node: all that Slurm started."""
        marks = {f"SLURM_CONF={self.conf}"} | ({f"SLURMD_NODENAME={node}"} if node else set())
        daemons, found = {daemon.pid for daemon in self.daemons.values()}, []
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                given = set((folder / "environ").read_bytes().decode(errors="replace").split("\0"))
            except OSError:
                continue
            on_a_node = any(variable.startswith("SLURMD_NODENAME=") for variable in given)
            if marks <= given and on_a_node and int(folder.name) not in daemons:
                found.append(int(folder.name))
        return found

    def ask(self, *command: str, check: bool = True, cwd: Path | None = None) -> str:
        """Run a Slurm command and return what it prints."""
        done = subprocess.run(
            command, env=self.environment, capture_output=True, text=True, timeout=60, cwd=cwd
        )
        assert not check or done.returncode == 0, done.stderr
        return done.stdout.strip()

    def queue(self) -> dict[str, str]:
        """Return the state of every waiting or running task, by ``<array>_<index>``."""
        lines = self.ask("squeue", "-h", "-r", "-o", "%i %T").splitlines()
        return dict(line.split() for line in lines)

    def running(self, array: int | None, node: str | None = None) -> str | None:
        """Return the node of the first task of an array that runs (on this node)."""
        where = ("-w", node) if node else ()
        options = ("-h", "-r", "-t", "RUNNING", "-j", str(array), "-o", "%N")
        lines = self.ask("squeue", *options, *where).split()
        return lines[0] if lines else None

    def requeued(self) -> int:
        """Return how often jobs were put back into the queue because their node died."""
        return (self.folder / "slurmctld.log").read_text().count("due to failure of node")

    def ended(self, job: str) -> bool:
        """Tell whether nothing of a job or array waits or runs."""
        return not any(task.split("_")[0] == job for task in self.queue())

    def stop(self) -> None:
        """End all daemons and jobs, and remove the folder."""
        for name in [*self.nodes, "slurmctld", "munged"]:
            if daemon := self.daemons.pop(name, None):
                _signal(daemon.pid, signal.SIGKILL)
                daemon.wait()
        for pid in self.processes():
            _signal(pid, signal.SIGKILL)
        wait_until(lambda: not self.processes())
        shutil.rmtree(self.folder)

    def _start(self, name: str, *command: str, **variables: str) -> None:
        environment = {**self.environment, **variables}
        with (self.folder / f"{name}.out").open("wb") as log:
            self.daemons[name] = subprocess.Popen(
                command, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )


def _free_ports(address: str, count: int) -> list[int]:
    sockets = [socket.create_server((address, 0)) for _ in range(count)]
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


def _signal(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)
