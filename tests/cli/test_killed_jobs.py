"""Jobs side by side: what happens to one of them happens to no other."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not os.path.isdir("/proc"), reason="finds processes in /proc"),
]

STICK = "name: stick\nbody: {module: core, children: {left: {module: hinge}}}\n"
SWEEP = ["--multirun", "hydra/launcher=parallel", "hydra.launcher.n_jobs=2", "robot=stick.yaml"]
SWEEP += ["env.num_envs=3", "ppo.steps=4", "ppo.minibatch_size=6", "physics.threads=1"]
SWEEP += ["checkpoint_interval=1", "seed=0,1", "ppo.iterations=100000"]


class Sweep:
    """A sweep whose two jobs both run, in ``sweep/``; they would not end by themselves."""

    def __init__(self, folder, *overrides):
        (folder / "stick.yaml").write_text(STICK)
        self.folder = folder / "sweep"
        line = [sys.executable, "-m", "locomotion.train", *SWEEP, *overrides]
        keywords = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        # As a script starts what it puts into the background.
        line = ["sh", "-c", 'trap "" INT; exec "$@"', "sh", *line]
        self.process = subprocess.Popen(line, cwd=folder, start_new_session=True, **keywords)
        self.jobs = {number: self._pid_of(number) for number in (0, 1)}

    def _pid_of(self, number):
        """The process that trains in a job's folder, once it has a row of metrics."""
        place = self.folder / str(number)
        rows = place / "metrics.csv"
        while not (rows.is_file() and rows.read_text().count("\n") > 1):
            assert self.process.poll() is None, self.process.communicate()[1]
            time.sleep(0.1)
        for file in Path("/proc").glob("[0-9]*/fd/*"):
            with contextlib.suppress(OSError):  # files and processes come and go
                if file.readlink() == place / ".lock":
                    return int(file.parts[2])
        raise AssertionError(f"nobody trains in {place}")

    def end(self):
        out, err = self.process.communicate(timeout=250)
        return self.process.returncode, out, err.splitlines()


@pytest.fixture
def sweep(tmp_path):
    started = []

    def start(*overrides):
        started.append(Sweep(tmp_path, *overrides))
        return started[-1]

    yield start
    for one in started:
        if one.process.poll() is None:
            os.killpg(one.process.pid, signal.SIGKILL)


def test_a_killed_job_is_named_in_a_line_and_the_others_go_on(sweep):
    running = sweep("hydra.sweep.dir=sweep")
    os.kill(running.jobs[0], signal.SIGKILL)
    line = running.process.stderr.readline()
    assert line.startswith("error: job 0 (robot=stick-file ")
    assert " seed=0 " in line
    assert " in sweep/0 was killed by SIGKILL, as happens when memory runs out;" in line
    assert line.endswith("; the same command resumes it\n")
    os.kill(running.jobs[1], 0)  # is still there
    os.kill(running.jobs[1], signal.SIGTERM)  # the rest would take too long
    status, _, err = running.end()
    assert "the same command" not in "".join(err)
    assert status == 130


def test_a_sweep_with_a_killed_job_ends_with_1(sweep):
    running = sweep("hydra.sweep.dir=${now:%Y}/../sweep")
    for job in (0, 1):
        os.kill(running.jobs[job], signal.SIGKILL)
    status, _, err = running.end()
    assert status == 1
    assert len(err) == 2
    year = time.strftime("%Y")
    # With a time in the folder's name, the same command alone would start anew.
    again = f"the same command with hydra.sweep.dir={year}/../sweep resumes it"
    assert all(again in line for line in err)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_all_running_jobs_are_saved_when_the_sweep_is_stopped(number, sweep, tmp_path):
    running = sweep("hydra.sweep.dir=sweep", "seed=0,1,2", "checkpoint_interval=1000000")
    # A terminal sends Ctrl-C to the whole group, kill to one process.
    if number == signal.SIGINT:
        os.killpg(running.process.pid, number)
    else:
        running.process.send_signal(number)
    status, _, err = running.end()
    assert status == 130
    assert not any("Traceback" in line for line in err)
    for job in (0, 1):
        folder = tmp_path / "sweep" / str(job)
        rows = len((folder / "metrics.csv").read_text().splitlines()) - 1
        assert (folder / "checkpoints" / f"{rows:06d}.ckpt").is_file()
        assert any(f"stopped after {rows} iterations; resume={folder} continues" in x for x in err)
    assert not (tmp_path / "sweep" / "2").exists()


def test_jobs_stop_when_the_process_that_started_them_is_gone(sweep, tmp_path):
    running = sweep("hydra.sweep.dir=sweep")
    running.process.kill()
    running.end()
    deadline = time.monotonic() + 200
    while any(os.path.exists(f"/proc/{pid}") for pid in running.jobs.values()):
        assert time.monotonic() < deadline
        time.sleep(0.2)


def test_a_job_that_cannot_run_leaves_the_others_alone(command, small, stick, write, tmp_path):
    write("stick.yaml", stick)
    write("sweep/0/.hydra/config.yaml", "seed: 7\n")
    arguments = ["--multirun", "hydra/launcher=parallel", "hydra.launcher.n_jobs=1", *small]
    arguments += ["robot=stick.yaml", "seed=0,1", "hydra.sweep.dir=sweep", "plugins=[breaks]"]
    # Between the check and the job somebody else has written there.
    code = "import multiprocessing, pathlib\nif multiprocessing.parent_process():\n"
    code += " pathlib.Path('sweep/0/metrics.csv').write_text('iteration\\n')\n"
    write("site/breaks.py", code)
    result = command("train", *arguments, cwd=tmp_path, path=tmp_path / "site")
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert f"{tmp_path}/sweep/0 holds a run with " in result.stderr
    assert "sweep/1: " in result.stdout
