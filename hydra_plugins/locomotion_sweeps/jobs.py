"""The jobs of a sweep: running one in any process, and reporting all."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import cloudpickle
from hydra.core.hydra_config import HydraConfig
from hydra.core.singleton import Singleton
from hydra.core.utils import JobReturn, JobStatus, filter_overrides, run_job, setup_globals
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, OmegaConf, open_dict
from tqdm import tqdm

#: A job: its number, and its overrides.
Job = tuple[int, Sequence[str]]

#: Exit status of a job that was asked to stop.
STOPPED = 130
#: Exit status of a job that cannot be run as it is.
REFUSED = 2
#: Time in which a job that was lost must have let go of its folder (s).
_PATIENCE = 60


class Outcome(NamedTuple):
    """The end of a job.

    Attributes:
        status: its exit status; below 0 the signal that killed it.
        value: what it returned.
        output: what it printed, for whoever has not seen it.
        reason: why it could not say itself what was wrong.
    """

    status: int
    value: Any = None
    output: str = ""
    reason: str = ""


class JobLauncher(Launcher):
    """Base class of launchers that run jobs in other processes.

    What happens to one job happens to no other: one that is killed is named in a line, and the others finish.
    """

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
        jobs = list(enumerate(job_overrides, initial_job_idx))
        # By value where a name cannot be imported, as that of a class which was made while running.
        state = Singleton.get_state()
        common = cloudpickle.dumps((self._context, self._task, self._config, state, os.getcwd()))
        results: dict[int, JobReturn] = {}
        status = 0
        with Progress(len(jobs)) as progress:
            for number, outcome in self.run(common, jobs, progress):
                overrides = list(job_overrides[number - initial_job_idx])
                progress.write(outcome.output)
                if outcome.status:
                    if outcome.status < 0 or outcome.reason:
                        progress.write(self.explanation(number, overrides, outcome), sys.stderr)
                    status = max(status, outcome.status, 1)
                else:
                    results[number] = JobReturn(overrides=overrides, status=JobStatus.COMPLETED)
                    results[number].return_value = outcome.value
        if status:
            sys.exit(status)
        return [results[number] for number in sorted(results)]

    def run(
        self, common: bytes, jobs: Sequence[Job], progress: Progress
    ) -> Iterator[tuple[int, Outcome]]:
        """Runs jobs, and gives out the number of each with its outcome when it is over.

        Args:
            common: what :func:`work` wants to know of the sweep.
            jobs: all of them.
            progress: to be told when a job begins, by :meth:`Progress.show`.
        """
        raise NotImplementedError

    @property
    def folder(self) -> Path:
        """The folder of the sweep."""
        return Path(self._config.hydra.sweep.dir)

    @property
    def resumed_by(self) -> str:
        """Words for what resumes the sweep."""
        # The folder may have a name that changes, such as the time.
        moving = OmegaConf.is_interpolation(self._config.hydra.sweep, "dir")
        return "the same command" + (f" with hydra.sweep.dir={self.folder}" if moving else "")

    def explanation(self, number: int, overrides: Sequence[str], outcome: Outcome) -> str:
        """Names a job that could not say itself what was wrong, in a line."""
        sweep = composed(self._context, self._config, number, overrides).hydra.sweep
        folder, given = Path(sweep.dir, sweep.subdir), " ".join(filter_overrides(overrides))
        reason = outcome.reason
        if outcome.status < 0:
            name = signal.Signals(-outcome.status).name
            hint = ", as happens when memory runs out" if name == "SIGKILL" else ""
            reason = f"was killed by {name}{hint}"
        return f"error: job {number} ({given}) in {folder} {reason}; {self.resumed_by} resumes it"


class Progress:
    """One line that moves, on a terminal: jobs done, running and waiting, and the time left.

    Args:
        jobs: how many there are.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs, self._ended = jobs, 0
        self._bar = tqdm(total=jobs, desc="jobs", unit="job", disable=None)

    def show(self, running: int, retried: int = 0, ended: int = 0) -> None:
        """Shows how many jobs run now, how many were started once more, and how many more have ended."""
        self._ended += ended
        waiting = self._jobs - self._ended - running
        again = f", {retried} retried" if retried else ""
        self._bar.set_postfix_str(f"{running} running, {waiting} waiting{again}", refresh=False)
        self._bar.update(ended)
        self._bar.refresh()

    def write(self, text: str, file: Any = None) -> None:
        """Writes lines above the bar."""
        if text:
            with tqdm.external_write_mode():
                print(text.rstrip("\n"), file=file or sys.stdout, flush=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()


def composed(
    context: HydraContext, config: DictConfig, number: int, overrides: Sequence[str]
) -> DictConfig:
    """The configuration of a job."""
    job = context.config_loader.load_sweep_config(config, list(overrides))
    with open_dict(job):
        job.hydra.job.num = number
        job.hydra.job.id = f"{job.hydra.job.name}_{number}"
    HydraConfig.instance().set_config(job)
    return job


def work(
    common: bytes,
    number: int,
    overrides: Sequence[str],
    errors: bool = False,
    restarted: Callable[[], bool] = lambda: False,
) -> Outcome:
    """Runs a job in this process, whose main thread calls it. SIGINT and SIGTERM stop it, once it is saved.

    Args:
        common: the sweep, as :meth:`JobLauncher.launch` packs it.
        number: of the job.
        overrides: of the job.
        errors: whether what it prints on standard error is part of its output too.
        restarted: says whether it was lost with its node. What is left of it may hold its folder a while longer,
            so a job that is refused tries again.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    deadline = time.monotonic() + _PATIENCE
    while (outcome := _attempt(common, number, overrides, errors)).status == REFUSED:
        if not restarted() or time.monotonic() > deadline:
            break
        time.sleep(1)
    return outcome


def _attempt(common: bytes, number: int, overrides: Sequence[str], errors: bool) -> Outcome:
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.ExitStack() as also:
        if errors:
            also.enter_context(contextlib.redirect_stderr(output))
        try:
            value, status = _run(common, number, overrides), 0
        except KeyboardInterrupt:  # before the job itself could be asked to stop
            value, status = None, STOPPED
        except SystemExit as ended:
            value, status = (
                None,
                ended.code if isinstance(ended.code, int) else int(ended.code is not None),
            )
        except Exception:  # noqa: BLE001  what a job raises ends that job alone
            traceback.print_exc()
            value, status = None, 1
    return Outcome(status, value, output.getvalue())


def _run(common: bytes, number: int, overrides: Sequence[str]) -> Any:
    context, task, config, state, folder = cloudpickle.loads(common)
    os.chdir(folder)  # folders are relative to that of the command
    setup_globals()
    Singleton.set_state(state)
    done = run_job(
        hydra_context=context,
        task_function=task,
        config=composed(context, config, number, overrides),
        job_dir_key="hydra.sweep.dir",
        job_subdir_key="hydra.sweep.subdir",
    )
    return done.return_value
