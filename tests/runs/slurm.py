"""A Slurm of two nodes on the loopback interface, without accounting."""

import os
import secrets
import shutil
import signal
import socket
import subprocess
import time

CONFIG = """
ClusterName=loopback
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.sock,cred_expire=5
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
MailProg=/bin/true
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SchedulerParameters=sched_interval=2,batch_sched_delay=0
KillWait=5
ReturnToService=2
SlurmdParameters=config_overrides
StateSaveLocation={folder}/state
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmdSpoolDir={folder}/spool-%n
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
NodeName=n0 NodeHostname={host} NodeAddr=127.0.0.1 Port={first} CPUs=1 RealMemory=8000
NodeName=n1 NodeHostname={host} NodeAddr=127.0.0.1 Port={second} CPUs=1 RealMemory=8000
PartitionName=cpu Nodes=n0,n1 Default=YES State=UP MaxTime=INFINITE
"""

#: Without these there is no Slurm; Debian's packages slurmctld, slurmd, slurm-client and munge bring them.
PROGRAMS = ("slurmctld", "slurmd", "sbatch", "munged")


class Slurm:
    """Starts the daemons; as root, as Slurm wants it.

    Args:
        folder: for all their files; its path must be short enough for a socket.
    """

    def __init__(self, folder):
        self.folder = folder
        for name in ("state", "spool-n0", "spool-n1"):
            (folder / name).mkdir()
        folder.chmod(0o755)
        names = ("controller", "first", "second")
        ports = dict(zip(names, free_ports(3)))
        host = socket.gethostname().partition(".")[0]
        conf = folder / "slurm.conf"
        conf.write_text(CONFIG.format(folder=folder, host=host, **ports))
        self.variables = {**os.environ, "SLURM_CONF": str(conf)}
        key = folder / "munge.key"
        key.write_bytes(secrets.token_bytes(1024))
        key.chmod(0o600)
        munge = ["munged", "--force", "--foreground", f"--socket={folder}/munge.sock"]
        munge += [f"--key-file={key}", f"--pid-file={folder}/munge.pid"]
        munge += [f"--log-file={folder}/munge.log", f"--seed-file={folder}/munge.seed"]
        self.daemons = [self._start(munge)]
        wait_until((folder / "munge.sock").exists)
        self.daemons += [
            self._start(line)
            for line in (
                ["slurmctld", "-D"],
                ["slurmd", "-D", "-N", "n0"],
                ["slurmd", "-D", "-N", "n1"],
            )
        ]
        wait_until(lambda: self.says("sinfo", "-h", "-N", "-o", "%T").split() == ["idle"] * 2)

    def _start(self, line):
        program = shutil.which(line[0]) or f"/usr/sbin/{line[0]}"
        with (self.folder / f"{line[0]}.out").open("ab") as log:
            return subprocess.Popen(
                [program, *line[1:]],
                env=self.variables,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def says(self, *line):
        """The output of one of Slurm's commands."""
        done = subprocess.run(line, env=self.variables, capture_output=True, text=True)
        return done.stdout

    def close(self):
        """Ends all jobs and daemons."""
        self.says("scancel", "--user=root")
        time.sleep(1)
        for daemon in reversed(self.daemons):
            daemon.send_signal(signal.SIGTERM)
        for daemon in self.daemons:
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()


def free_ports(count):
    """Ports that nobody listens on."""
    held = [socket.socket() for _ in range(count)]
    for one in held:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in held]
    for one in held:
        one.close()
    return ports


def wait_until(condition, timeout=60):
    """Waits for a condition; what it is must be plain from where this is called."""
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.2)
