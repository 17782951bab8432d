"""A launcher: the jobs of a sweep as an array of Slurm's."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from hydra_plugins.locomotion_sweeps.jobs import STOPPED, Job, JobLauncher, Outcome, Progress, work
from hydra_plugins.locomotion_sweeps.needs import fail, require_package

#: States in which a job comes no further.
_OVER = {
    *("BOOT_FAIL", "CANCELLED", "COMPLETED", "DEADLINE", "FAILED", "NODE_FAIL", "OUT_OF_MEMORY"),
    *("PREEMPTED", "REVOKED", "TIMEOUT"),
}
#: Time between two looks at the queue (s); one that is looked at all the time gets slow for all.
_INTERVAL = 2.0
#: Looks after which a job that is over and has left no outcome is lost; shared folders lag behind.
_PATIENCE = 5
#: Time before the limit at which a job is told to save (s).
_WARNING = 60
#: Time in which a second Ctrl-C cancels the jobs (s).
_CHOICE = 5.0


class SlurmLauncher(JobLauncher):
    """Submits jobs as one array, follows them, and starts none that is in the queue already.

    Nodes share the sweep's folder. Slurm starts a job whose node is lost once more; one that reaches its time
    limit saves and queues again. Ctrl-C leaves the jobs in the queue, where the same command finds them; a
    second one cancels them.

    Args:
        partition: to be submitted to; ``None``: Slurm's default.
        account: that is charged, likewise.
        qos: quality of service, likewise.
        constraint: features that nodes must have, likewise.
        time: limit of a job (minutes); longer runs take several turns.
        cpus: cores of a job.
        gpus: of a job.
        memory: of a job (GiB).
        n_jobs: how many run at once.
    """

    def __init__(
        self,
        partition: str | None,
        account: str | None,
        qos: str | None,
        constraint: str | None,
        time: int,
        cpus: int,
        gpus: int,
        memory: float,
        n_jobs: int,
    ) -> None:
        require_package("submitit", "slurm")
        if shutil.which("sbatch") is None:
            fail(
                "hydra/launcher=slurm needs Slurm's commands, such as sbatch, which are not here", 2
            )
        wanted = {
            "partition": partition,
            "account": account,
            "qos": qos,
            "constraint": constraint,
            "gpus_per_node": gpus or None,
        }
        self._options: dict[str, Any] = {
            "time": time,
            "cpus_per_task": cpus,
            "mem": f"{int(memory * 1024)}MB",
            "array_parallelism": n_jobs,
            "signal_delay_s": _WARNING,
            "job_name": "locomotion",
            **{name: value for name, value in wanted.items() if value is not None},
        }

    def run(
        self, common: bytes, jobs: Sequence[Job], progress: Progress
    ) -> Iterator[tuple[int, Outcome]]:
        desk = (self.folder / ".slurm").absolute()
        desk.mkdir(parents=True, exist_ok=True)
        tasks = _queued(desk, jobs)
        if tasks:
            progress.write(f"{len(tasks)} jobs of this sweep are in the queue", sys.stderr)
        tasks |= self._submit(common, desk, [job for job in jobs if job[0] not in tasks])
        record = {"tasks": tasks, "overrides": {number: list(job) for number, job in jobs}}
        _write(desk / "jobs.json", record)
        try:
            yield from _follow(desk, tasks, progress)
        except KeyboardInterrupt:
            self._leave_or_cancel(tasks.values())
            raise

    def _submit(self, common: bytes, desk: Path, jobs: Sequence[Job]) -> dict[int, str]:
        """Submits jobs; the name of each in the queue by its number."""
        if not jobs:
            return {}
        import submitit

        executor = submitit.SlurmExecutor(folder=desk / "jobs")
        executor.update_parameters(**self._options)
        numbers, overrides = zip(*((number, list(job)) for number, job in jobs))
        try:
            submitted = executor.map_array(Attempt(common, str(desk)), numbers, overrides)
        except submitit.core.utils.FailedJobError as error:
            fail(f"Slurm took no job: {' '.join(str(error).split())}")
        return {number: job.job_id for number, job in zip(numbers, submitted)}

    def _leave_or_cancel(self, tasks: Iterable[str]) -> None:
        there = [
            task for task in tasks if (_states([task]) or {}).get(task, "COMPLETED") not in _OVER
        ]
        print(
            f"{len(there)} jobs stay in the queue, where {self.resumed_by} finds them;"
            f" Ctrl-C within {_CHOICE:.0f} s cancels them",
            file=sys.stderr,
            flush=True,
        )
        try:
            time.sleep(_CHOICE)
        except KeyboardInterrupt:
            subprocess.run(["scancel", *there], check=False)
            print(f"cancelled; {self.resumed_by} resumes them", file=sys.stderr, flush=True)


class Attempt:
    """A job in Slurm's hands.

    Args:
        common: the sweep, as :meth:`JobLauncher.launch` packs it.
        desk: the folder in which outcomes are left.
    """

    def __init__(self, common: bytes, desk: str) -> None:
        self._common, self._desk = common, desk

    def __call__(self, number: int, overrides: Sequence[str]) -> None:
        """Runs the job and leaves its outcome; one that has reached its time limit is queued again."""
        task = os.environ["SLURM_JOB_ID"]
        if "SLURM_ARRAY_JOB_ID" in os.environ:
            task = f"{os.environ['SLURM_ARRAY_JOB_ID']}_{os.environ['SLURM_ARRAY_TASK_ID']}"
        starts = int(os.environ.get("SLURM_RESTART_COUNT", "0"))
        os.environ["LOKY_MAX_CPU_COUNT"] = os.environ.get("SLURM_CPUS_PER_TASK", "1")
        place = Path(self._desk, f"{number}.json")
        _write(place, {"task": task, "restarts": starts})
        reached = []

        def save(*_: object) -> None:
            reached.append(True)
            signal.raise_signal(signal.SIGTERM)

        signal.signal(signal.SIGUSR2, save)
        outcome = work(self._common, number, overrides, errors=True, restarted=lambda: starts > 0)
        signal.signal(signal.SIGUSR2, signal.SIG_IGN)
        if reached and outcome.status:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            if subprocess.run(["scontrol", "requeue", task], check=False).returncode == 0:
                time.sleep(600)  # Slurm ends this process
            outcome = Outcome(
                1, reason="has reached its time limit, and Slurm does not queue it again"
            )
        _write(place, {"task": task, "restarts": starts, **outcome._asdict()})


def _follow(desk: Path, tasks: dict[int, str], progress: Progress) -> Iterator[tuple[int, Outcome]]:
    """Waits for jobs, and gives out the number of each with its outcome when it is over."""
    following, silent = dict(tasks), dict.fromkeys(tasks, 0)
    retried: dict[int, int] = {}
    while following:
        states = _states(following.values())
        ended: list[tuple[int, Outcome]] = []
        for number, task in following.items():
            found = _read(desk / f"{number}.json")
            found = found if found.get("task") == task else {}
            retried[number] = found.get("restarts", 0)
            state = "UNKNOWN" if states is None else states.get(task, "COMPLETED")
            over = state in _OVER
            # Slurm stops a job before it starts it again elsewhere; that is not its end.
            if "status" in found and (over or found["status"] != STOPPED):
                told = {name: found[name] for name in Outcome._fields}
                ended.append((number, Outcome(**told)))
            elif over:
                silent[number] += 1
                if silent[number] > _PATIENCE:
                    words = f"was lost (Slurm says {state.lower().replace('_', ' ')})"
                    ended.append((number, Outcome(1, reason=words)))
            else:
                silent[number] = 0
        for number, _ in ended:
            del following[number]
        running = [task for task in following.values() if (states or {}).get(task) == "RUNNING"]
        progress.show(len(running), sum(retried.values()), len(ended))
        yield from ended
        if following:
            time.sleep(_INTERVAL)


def _queued(desk: Path, jobs: Sequence[Job]) -> dict[int, str]:
    """The names of jobs in the queue by their numbers, those that an earlier command has submitted."""
    record = _read(desk / "jobs.json")
    before, tasks = record.get("overrides", {}), record.get("tasks", {})
    known = {
        number: str(tasks[str(number)])
        for number, overrides in jobs
        if str(number) in tasks and before.get(str(number)) == list(overrides)
    }
    states = (_states(known.values()) or {}) if known else {}
    return {
        number: task for number, task in known.items() if states.get(task, "COMPLETED") not in _OVER
    }


def _states(tasks: Iterable[str]) -> dict[str, str] | None:
    """States of jobs in the queue by their names; ``None`` if Slurm does not answer."""
    arrays = ",".join(sorted({task.partition("_")[0] for task in tasks}))
    if not arrays.replace(",", "").isdigit():  # a record that is not ours
        return {}
    asked = [
        "squeue",
        "--noheader",
        "--array",
        "--states=all",
        "--format=%F_%K %T",
        f"--jobs={arrays}",
    ]
    answer = subprocess.run(asked, capture_output=True, encoding="utf-8", check=False)
    if answer.returncode:  # it also fails for jobs that it has forgotten
        return {} if "Invalid job id" in answer.stderr else None
    lines = (line.split() for line in answer.stdout.splitlines())
    return {name.removesuffix("_N/A"): state for name, state in lines}


def _read(path: Path) -> dict[str, Any]:
    """The content of a JSON file of ours; empty if it is not there, or is not one."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _write(path: Path, content: dict[str, Any]) -> None:
    """Writes a file whole."""
    partial = path.with_name(f"{path.name}.{os.getpid()}.part")
    partial.write_text(json.dumps(content), encoding="utf-8")
    os.replace(partial, path)
