"""A launcher: each job of a sweep in a process of its own, some at once.

What happens to one job happens to no other: one that is killed is named in a line, and the others finish.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Collection, Iterator, Sequence
from multiprocessing import connection, resource_tracker
from pathlib import Path
from typing import Any, NamedTuple

import cloudpickle
from hydra.core.hydra_config import HydraConfig
from hydra.core.singleton import Singleton
from hydra.core.utils import JobReturn, JobStatus, filter_overrides, run_job, setup_globals
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, OmegaConf, open_dict

#: What a process is asked to stop with.
_STOPPING = {signal.SIGINT, signal.SIGTERM}


class _Job(NamedTuple):
    number: int
    overrides: list[str]
    process: Any
    result: connection.Connection


class ProcessLauncher(Launcher):
    """Starts each job in a fresh interpreter.

    Ctrl-C and SIGTERM ask all jobs that run to stop, as SIGTERM asks one, and wait for them; once more
    asks them once more. Jobs also stop when the launcher's process is gone.

    Args:
        n_jobs: how many run at once.
    """

    def __init__(self, n_jobs: int) -> None:
        self._n_jobs = n_jobs

    def setup(
        self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig
    ) -> None:
        self._context, self._task, self._config = hydra_context, task_function, config

    def launch(
        self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int
    ) -> Sequence[JobReturn]:
        """Runs the jobs and returns their results.

        Raises:
            SystemExit: with the highest exit status of the jobs, once all are over, unless that is 0.
                One that was killed counts as 1; others have said themselves what was wrong.
            KeyboardInterrupt: if it was asked to stop, once all are over.
        """
        # By value where a name cannot be imported, as that of a class which was made while running.
        common = cloudpickle.dumps((self._context, self._task, self._config, Singleton.get_state()))
        waiting = deque(enumerate(job_overrides, initial_job_idx))
        running: dict[connection.Connection, _Job] = {}
        results: dict[int, JobReturn] = {}
        status = 0
        try:
            while waiting or running:
                while waiting and len(running) < self._n_jobs:
                    _start(common, *waiting.popleft(), running)
                for ready in connection.wait(list(running)):
                    job = running[ready]
                    value, ended = _outcome(job)
                    del running[ready]
                    if ended:
                        self._explain(job, ended)
                        status = max(status, ended, 1)
                    else:
                        results[job.number] = JobReturn(
                            overrides=job.overrides, status=JobStatus.COMPLETED
                        )
                        results[job.number].return_value = value
        finally:
            _stop(running.values())
        if status:
            sys.exit(status)
        return [results[number] for number in sorted(results)]

    def _explain(self, job: _Job, status: int) -> None:
        """Names a job that was killed, in a line; one that ended by itself has said why."""
        if status > 0:
            return
        name = signal.Signals(-status).name
        hint = ", as happens when memory runs out" if name == "SIGKILL" else ""
        sweep = _composed(self._context, self._config, job.number, job.overrides).hydra.sweep
        folder, given = Path(sweep.dir, sweep.subdir), " ".join(filter_overrides(job.overrides))
        moving = OmegaConf.is_interpolation(self._config.hydra.sweep, "dir")  # such as the time
        place = f" with hydra.sweep.dir={sweep.dir}" if moving else ""
        print(
            f"error: job {job.number} ({given}) in {folder} was killed by {name}{hint};"
            f" the same command{place} resumes it",
            file=sys.stderr,
            flush=True,
        )


def _composed(
    context: HydraContext, config: DictConfig, number: int, overrides: Sequence[str]
) -> DictConfig:
    """The configuration of a job."""
    job = context.config_loader.load_sweep_config(config, list(overrides))
    with open_dict(job):
        job.hydra.job.num = number
        job.hydra.job.id = f"{job.hydra.job.name}_{number}"
    HydraConfig.instance().set_config(job)
    return job


def _start(
    common: bytes,
    number: int,
    overrides: Sequence[str],
    running: dict[connection.Connection, _Job],
) -> None:
    """Starts a job and adds it to those that run."""
    spawn = multiprocessing.get_context("spawn")
    result, write = spawn.Pipe(duplex=False)
    arguments = (common, number, list(overrides), write)
    process = spawn.Process(target=_work, args=arguments, name=f"job {number}")
    _ensure_tracker()
    # A terminal sends Ctrl-C to all processes. The jobs inherit that it waits, and hear of it from here.
    with _signals_wait():
        process.start()
        running[result] = _Job(number, list(overrides), process, result)
    write.close()  # so that the job's end is the end of what can be read


@contextlib.contextmanager
def _signals_wait() -> Iterator[None]:
    """Lets what would stop this process wait until the block's end, except on Windows, which cannot."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _STOPPING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _ensure_tracker() -> None:
    """Starts Python's process that removes what others leave behind, which unblocks signals.

    It would also warn of what it removes after a job that was killed.
    """
    name = "PYTHONWARNINGS"
    before = os.environ.get(name)
    quiet = "ignore:resource_tracker:UserWarning"
    os.environ[name] = f"{before},{quiet}" if before else quiet
    try:
        resource_tracker.ensure_running()
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


def _outcome(job: _Job) -> tuple[Any, int]:
    """The value that a finished job has returned, and its exit status: below 0 if it was killed."""
    try:
        value = cloudpickle.loads(job.result.recv_bytes())
    except EOFError:
        job.process.join()
        return None, job.process.exitcode or 1
    job.process.join()
    return value, 0


def _stop(jobs: Collection[_Job]) -> None:
    """Asks jobs to stop and waits until they have; asked once more meanwhile, asks them once more."""
    while any(job.process.is_alive() for job in jobs):
        try:
            for job in jobs:
                job.process.terminate()
            for job in jobs:
                job.process.join()
        except KeyboardInterrupt:
            continue


def _work(common: bytes, number: int, overrides: list[str], result: connection.Connection) -> None:
    """Runs a job, in its own process."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
        threading.Thread(target=_stop_with_launcher, daemon=True).start()
        context, task, config, state = cloudpickle.loads(common)
        setup_globals()
        Singleton.set_state(state)
        done = run_job(
            hydra_context=context,
            task_function=task,
            config=_composed(context, config, number, overrides),
            job_dir_key="hydra.sweep.dir",
            job_subdir_key="hydra.sweep.subdir",
        )
        result.send_bytes(cloudpickle.dumps(done.return_value))
    except KeyboardInterrupt:  # before the job itself could be asked to stop
        sys.exit(130)


def _stop_with_launcher() -> None:
    launcher = multiprocessing.parent_process()
    if launcher is not None:
        launcher.join()
        os.kill(os.getpid(), signal.SIGTERM)
