"""A sweep on a real Slurm: left, found again, at its time limit, on a node that is lost, cancelled."""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from slurm import PROGRAMS, Slurm, wait_until

from locomotion import train

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        any(not shutil.which(name) and not Path("/usr/sbin", name).exists() for name in PROGRAMS),
        reason="needs Slurm: apt-get install slurmctld slurmd slurm-client munge",
    ),
    pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="Slurm runs as root"),
]
SEEDS = (0, 1, 2)
LONG = ("ppo.iterations=100", "checkpoint_interval=1000")


@pytest.fixture(scope="module")
def slurm():
    pytest.importorskip("submitit", reason="needs packages: pip install -e '.[slurm]'")
    folder = Path(tempfile.mkdtemp(prefix="slurm"))
    cluster = Slurm(folder)
    yield cluster
    cluster.close()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def sweep(slurm, small, tmp_path):
    """Starts a sweep on the cluster."""
    started = []

    def start(*overrides):
        line = [sys.executable, "-m", "locomotion.train", "--multirun", "hydra/launcher=slurm"]
        line += ["hydra.launcher.partition=cpu", "hydra.launcher.time=10"]
        line += ["hydra.sweep.dir=sweep", *small, *LONG, *overrides]
        process = subprocess.Popen(
            line,
            cwd=tmp_path,
            env=slurm.variables,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()


def rows_of(folder):
    path = folder / "metrics.csv"
    return path.read_text().count("\n") - 1 if path.is_file() else 0


def restarts(folder):
    """How often Slurm has started each job again."""
    return [
        json.loads(path.read_text())["restarts"]
        for path in sorted(folder.glob("sweep/.slurm/[0-9].json"))
    ]


def running(slurm):
    """The jobs that run: their names in the queue, and the nodes that they are on."""
    lines = slurm.says("squeue", "-h", "--array", "--states=RUNNING", "--format=%F_%K %N").split()
    return dict(zip(lines[::2], lines[1::2]))


def test_whatever_happens_to_jobs_leaves_no_trace_in_the_results(
    slurm, sweep, configured, outcome, tmp_path
):
    seeds = ",".join(map(str, SEEDS))
    folders = [tmp_path / "sweep" / str(number) for number in SEEDS]
    left = sweep(f"seed={seeds}")
    wait_until(lambda: left.poll() is not None or all(rows_of(f) > 2 for f in folders[:2]), 200)
    jobs = running(slurm)
    assert len(jobs) == 2
    (limited, _), (_, node) = jobs.items()
    # One is told that its time is over, as Slurm does a minute before; the other one's node is lost.
    slurm.says("scancel", "--signal=USR2", limited)
    slurm.says("scontrol", "update", f"nodename={node}", "state=down", "reason=test")
    slurm.says("scontrol", "update", f"nodename={node}", "state=resume")
    wait_until(lambda: left.poll() is not None or restarts(tmp_path).count(1) == 2, 200)
    assert left.poll() is None
    left.kill()  # as when a terminal is lost
    assert "stopped after" not in left.communicate()[0]
    again = sweep(f"seed={seeds}")
    out, err = again.communicate(timeout=400)
    assert again.returncode == 0, err
    assert "jobs of this sweep are in the queue" in err
    assert all(f"{folder}: " in out for folder in folders)
    for seed, folder in zip(SEEDS, folders):
        alone = train(configured(*LONG, f"seed={seed}"), tmp_path / f"alone{seed}")
        assert outcome(folder) == outcome(alone.folder)


def test_a_job_that_is_cancelled_saves_and_has_a_line(slurm, sweep, tmp_path):
    process = sweep("seed=5", "ppo.iterations=100000", "hydra.sweep.dir=cancelled")
    folder = tmp_path / "cancelled" / "0"
    wait_until(lambda: process.poll() is not None or rows_of(folder) > 2, 200)
    slurm.says("scancel", "--user=root")
    out, _ = process.communicate(timeout=100)
    assert process.returncode == 130
    rows = rows_of(folder)
    assert (folder / "checkpoints" / f"{rows:06d}.ckpt").is_file()
    assert f"stopped after {rows} iterations; resume=" in out


def test_two_interrupts_cancel_the_jobs(slurm, sweep, tmp_path):
    process = sweep("seed=6", "ppo.iterations=100000", "hydra.sweep.dir=twice")
    folder = tmp_path / "twice" / "0"
    wait_until(lambda: process.poll() is not None or rows_of(folder) > 2, 200)
    process.send_signal(signal.SIGINT)
    assert "1 jobs stay in the queue" in process.stderr.readline()
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "cancelled; the same command resumes them" in err
    wait_until(lambda: not running(slurm))
