"""A launcher: each job of a sweep in a process of its own, some at once."""

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
from typing import Any, NamedTuple

import cloudpickle

from hydra_plugins.locomotion_sweeps.jobs import STOPPED, Job, JobLauncher, Outcome, Progress, work

#: What a process is asked to stop with.
_STOPPING = {signal.SIGINT, signal.SIGTERM}


class _Started(NamedTuple):
    number: int
    process: Any
    result: connection.Connection


class ProcessLauncher(JobLauncher):
    """Starts each job in a fresh interpreter.

    Ctrl-C and SIGTERM ask all jobs that run to stop, as SIGTERM asks one, and wait for them; once more
    asks them once more. Jobs also stop when the launcher's process is gone.

    Args:
        n_jobs: how many run at once.
    """

    def __init__(self, n_jobs: int) -> None:
        self._n_jobs = n_jobs

    def run(
        self, common: bytes, jobs: Sequence[Job], progress: Progress
    ) -> Iterator[tuple[int, Outcome]]:
        waiting = deque(jobs)
        running: dict[connection.Connection, _Started] = {}
        try:
            while waiting or running:
                while waiting and len(running) < self._n_jobs:
                    _start(common, *waiting.popleft(), running)
                progress.show(len(running))
                for ready in connection.wait(list(running)):
                    job = running[ready]
                    outcome = _outcome(job)
                    del running[ready]
                    progress.show(len(running), ended=1)
                    yield job.number, outcome
        finally:
            _stop(running.values())


def _start(
    common: bytes,
    number: int,
    overrides: Sequence[str],
    running: dict[connection.Connection, _Started],
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
        running[result] = _Started(number, process, result)
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


def _outcome(job: _Started) -> Outcome:
    """The outcome of a job that is over."""
    try:
        outcome = cloudpickle.loads(job.result.recv_bytes())
    except EOFError:
        job.process.join()
        return Outcome(job.process.exitcode or 1)
    job.process.join()
    return outcome


def _stop(jobs: Collection[_Started]) -> None:
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
        result.send_bytes(cloudpickle.dumps(work(common, number, overrides)))
    except KeyboardInterrupt:
        sys.exit(STOPPED)


def _stop_with_launcher() -> None:
    launcher = multiprocessing.parent_process()
    if launcher is not None:
        launcher.join()
        os.kill(os.getpid(), signal.SIGTERM)
