"""A launcher: each job of a sweep as a task of a Ray cluster."""

from __future__ import annotations

import contextlib
import os
import platform
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from hydra_plugins.locomotion_sweeps.jobs import STOPPED, Job, JobLauncher, Outcome, Progress, work
from hydra_plugins.locomotion_sweeps.needs import fail, require_package

#: What must be the same on all nodes for runs to be.
PACKAGES = (
    "locomotion",
    "torch",
    "torchrl",
    "tensordict",
    "mujoco",
    "dm-control",
    "numpy",
    "cmaes",
)


class RayLauncher(JobLauncher):
    """Runs jobs on the cluster that ``RAY_ADDRESS`` names, or on one that it starts on this machine.

    Nodes share the sweep's folder. A job whose node or worker dies starts on another one and resumes from its
    last checkpoint. Ctrl-C asks the jobs that run to save and to stop.

    Args:
        cpus: cores of a job.
        gpus: of a job; a fraction lets several share one.
        memory: of a job (GiB).
        retries: how often a job may start once more.
    """

    def __init__(self, cpus: int, gpus: float, memory: float, retries: int) -> None:
        require_package("ray", "ray")
        self._retries = retries
        self._needs = {"num_cpus": cpus, "num_gpus": gpus, "memory": int(memory * 2**30)}

    def run(
        self, common: bytes, jobs: Sequence[Job], progress: Progress
    ) -> Iterator[tuple[int, Outcome]]:
        import ray

        with _cluster(ray):
            _require_room(ray, self._needs)
            _require_same_versions(ray)
            # Where this process is, so that no other node takes it along when it dies.
            board = _on(ray, ray.get_runtime_context().get_node_id(), Board).remote()
            task = ray.remote(max_calls=1, max_retries=self._retries, **self._needs)(attempt)
            packed = ray.put(common)
            running = {task.remote(board, packed, *job): job[0] for job in jobs}
            shown = 0
            try:
                while running:
                    ended, _ = ray.wait(list(running), timeout=1)
                    starts, ends = ray.get(board.counts.remote())
                    retried = sum(starts.values()) - len(starts)
                    progress.show(len(starts) - len(ends), retried, len(ends) - shown)
                    shown = len(ends)
                    for each in ended:
                        yield running.pop(each), _outcome(ray, each)
            except KeyboardInterrupt:
                print(
                    "stopping the jobs that run, once they are saved", file=sys.stderr, flush=True
                )
                for each in running:
                    ray.cancel(each)
                ray.wait(list(running), num_returns=len(running))
                raise


class Board:
    """An actor that knows which jobs have begun, how often, and which have ended."""

    def __init__(self) -> None:
        self._starts: Counter[int] = Counter()
        self._ends: set[int] = set()

    def start(self, number: int) -> int:
        """Notes that an attempt of a job begins, and returns how many there were before."""
        self._starts[number] += 1
        return self._starts[number] - 1

    def end(self, number: int) -> None:
        """Notes that a job has ended by itself."""
        self._ends.add(number)

    def counts(self) -> tuple[Counter[int], set[int]]:
        """The number of starts of each job, and the jobs that have ended."""
        return self._starts, self._ends


def attempt(board: Any, common: bytes, number: int, overrides: Sequence[str]) -> Outcome:
    """Runs a job in a worker of its own; it returns how that ended, as an exit counts as a crash to Ray."""
    import ray

    before = board.start.remote(number)  # who waits for a result lends its core to another job
    cores = ray.get_runtime_context().get_assigned_resources().get("CPU", 1)
    os.environ["LOKY_MAX_CPU_COUNT"] = str(
        max(1, int(cores))
    )  # of which physics.threads=null takes all
    outcome = work(common, number, overrides, errors=True, restarted=lambda: ray.get(before) > 0)
    ray.get(board.end.remote(number))
    return outcome


def _on(ray: Any, node: str, work: Any) -> Any:
    """A task or an actor that runs on a node or not at all, and takes no core of it."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    place = NodeAffinitySchedulingStrategy(node, soft=False)
    return ray.remote(num_cpus=0, scheduling_strategy=place)(work)


def _outcome(ray: Any, ended: Any) -> Outcome:
    """The outcome of a task that is over."""
    try:
        return ray.get(ended)
    except ray.exceptions.TaskCancelledError:
        return Outcome(STOPPED)
    except ray.exceptions.RayError as error:
        return Outcome(1, reason=f"was lost ({type(error).__name__})")


@contextlib.contextmanager
def _cluster(ray: Any) -> Iterator[None]:
    """Joins the cluster that is named, or starts one; one that this process has joined already is used."""
    if ray.is_initialized():
        yield
        return
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    address = os.environ.get("RAY_ADDRESS")
    # Jobs return what they print.
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
    if address is None:
        options |= {"address": "local", "include_dashboard": False}
    try:
        ray.init(**options)
    except ConnectionError as error:
        fail(f"RAY_ADDRESS={address} cannot be reached: {' '.join(str(error).split())}")
    try:
        yield
    finally:
        ray.shutdown()


def _require_room(ray: Any, needs: dict[str, Any]) -> None:
    """Ends if no node has room for a job, for which Ray would wait without a word."""
    names = {"num_cpus": "CPU", "num_gpus": "GPU", "memory": "memory"}
    wanted = {names[name]: value for name, value in needs.items() if value}
    nodes = [node["Resources"] for node in ray.nodes() if node["Alive"]]
    if not any(all(node.get(name, 0) >= value for name, value in wanted.items()) for node in nodes):
        words = ", ".join(f"{name}: {value:g}" for name, value in wanted.items())
        best = {name: max((node.get(name, 0) for node in nodes), default=0) for name in wanted}
        there = ", ".join(f"{name}: {value:g}" for name, value in best.items())
        fail(f"no node of the cluster has room for a job ({words}); the largest have {there}")


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide a run's numbers."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    return found


def _require_same_versions(ray: Any) -> None:
    """Ends if a node has other versions than this process."""
    own = versions()
    asked = {
        node["NodeManagerHostname"]: _on(ray, node["NodeID"], versions).remote()
        for node in ray.nodes()
        if node["Alive"]
    }
    for host, answer in asked.items():
        for name, there in ray.get(answer).items():
            if there != own[name]:
                fail(f"node {host} has {name} {there}, this machine {own[name]}; runs would differ")
