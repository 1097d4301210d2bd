"""Slurm on one machine: a controller, two workers and munge."""

import os
import shutil
import signal
import subprocess
import time

from servers import free_port

CONFIG = """\
ClusterName=farm
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={socket}
CryptoType=crypto/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool.%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.%n.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=0,sched_min_interval=0,bf_interval=1
SlurmdTimeout=10
SlurmctldTimeout=10
ReturnToService=2
MpiDefault=none
NodeName=n1 NodeHostname={host} NodeAddr=127.0.0.1 Port={first} CPUs=1 RealMemory=1024
NodeName=n2 NodeHostname={host} NodeAddr=127.0.0.1 Port={second} CPUs=1 RealMemory=1024
PartitionName=farm Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP
"""


class Slurm:
    """A cluster that lives as long as its `with` block."""

    def __init__(self, folder):
        self.folder, self.daemons = folder, {}
        (folder / "state").mkdir(parents=True)
        host = os.uname().nodename.split(".")[0]
        ports = {name: free_port() for name in ("controller", "first", "second")}
        self.socket = folder / "munge.socket"
        (folder / "slurm.conf").write_text(CONFIG.format(host=host, folder=folder, socket=self.socket, **ports))
        self.environment = {"SLURM_CONF": str(folder / "slurm.conf")}

    def __enter__(self):
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o600)
        # munge refuses folders that others can write to.
        self.folder.chmod(0o755)
        self.start("munged", ["munged", "--foreground", "--force", f"--key-file={key}", f"--socket={self.socket}",
                              f"--pid-file={self.folder}/munged.pid", f"--seed-file={self.folder}/munged.seed",
                              f"--log-file={self.folder}/munged.log"])
        self.until(lambda: self.socket.exists(), 20)
        self.start("slurmctld", [program("slurmctld"), "-D"])
        for node in ("n1", "n2"):
            (self.folder / f"spool.{node}").mkdir()
            self.start(node, [program("slurmd"), "-D", "-N", node])
        self.until(lambda: self.ask("sinfo", "-h", "-o", "%D %t") == "2 idle", 60)
        return self

    def __exit__(self, *_):
        for daemon in reversed(list(self.daemons.values())):
            daemon.terminate()
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()

    def start(self, name, command):
        log = open(self.folder / f"{name}.out", "w")
        self.daemons[name] = subprocess.Popen(command, env={**os.environ, **self.environment}, stdout=log, stderr=log)

    def ask(self, *command):
        return subprocess.run(command, env={**os.environ, **self.environment}, capture_output=True,
                              text=True).stdout.strip()

    def until(self, test, seconds):
        end = time.monotonic() + seconds
        while not test():
            logs = "".join(path.read_text()[-2000:] for path in self.folder.glob("*.log"))
            assert time.monotonic() < end, f"the cluster does not answer:\n{logs}"
            time.sleep(0.3)

    def kill(self, node):
        """Kills a worker and what runs on it, as if the machine had lost its power."""
        jobs = self.ask("squeue", "-h", "-t", "R", "-w", node, "-o", "%A").split()
        daemon = self.daemons.pop(node)
        daemon.send_signal(signal.SIGKILL)
        daemon.wait()
        for pid in children_with(f"SLURMD_NODENAME={node}", f"SLURM_CONF={self.environment['SLURM_CONF']}"):
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
        return jobs

    def wait_for_running(self, number):
        self.until(lambda: len(self.ask("squeue", "-h", "-t", "R", "-o", "%A").split()) >= number, 60)

    def wait(self, seconds):
        self.until(lambda: not self.ask("squeue", "-h", "-o", "%A"), seconds)


def program(name):
    return shutil.which(name) or f"/usr/sbin/{name}"


def children_with(*variables):
    """The processes of this test that have all these variables in their environment."""
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            environment = open(f"/proc/{pid}/environ").read().split("\0")
        except OSError:
            continue
        if all(variable in environment for variable in variables):
            yield int(pid)
