"""Sides of the benchmark of the time to a gait, started one after another and watched."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.bare import BareBatch
from benchmarks.gait_sides import EXPERIMENTS, Hyperparameters, Task
from benchmarks.gait_sides.record import MISSING_PACKAGE
from benchmarks.rows import usable_cores
from benchmarks.task import CONTROL_TIMESTEP, SETTLE_TIME

#: Seconds between two looks at a side.
LOOK = 0.1


class SideFailed(Exception):
    """A side that ended before it was done; the end of what it said."""


@dataclasses.dataclass(frozen=True)
class Limits:
    """The resources of a side.

    Attributes:
        seconds: after which it is ended, its start included.
        threads: of torch, unless the side sets them itself, as ours does.
        iterations: after which it is ended too; ``None`` for any number.
    """

    seconds: float
    threads: int
    iterations: int | None = None


@dataclasses.dataclass
class Run:
    """The record of a side.

    Attributes:
        side: its name.
        robot: name of the robot.
        seed: its seed.
        rows: iterations, as :class:`benchmarks.gait_sides.record.Recorder` writes them.
        missing: the package that it would have needed.
    """

    side: str
    robot: str
    seed: int
    rows: list[dict[str, float]] = dataclasses.field(default_factory=list)
    missing: str = ""


@dataclasses.dataclass(frozen=True)
class Robot:
    """A robot of the benchmark.

    Attributes:
        name: its name.
        model: file of the compiled robot.
        ours: hyperparameters of our ``+experiment=quick`` for it.
    """

    name: str
    model: Path
    ours: Hyperparameters


def prepare(name: str, folder: Path) -> Robot:
    """Compiles a robot, which all sides then step."""
    from locomotion import compose
    from locomotion.envs import LocomotionEnv

    config = compose(f"robot={name}", "+obs=history3", *EXPERIMENTS["quick"])
    env = LocomotionEnv(config.robot, num_envs=1)
    path = folder / f"{config.robot.name}.mjb"
    mujoco.mj_saveModel(env.model, str(path), None)
    ppo, network = config.learner, config.architecture
    ours = Hyperparameters(
        num_envs=config.env.num_envs,
        steps=ppo.steps,
        iterations=ppo.iterations,
        epochs=ppo.epochs,
        minibatch_size=ppo.minibatch_size,
        learning_rate=ppo.actor_lr,
        gamma=ppo.gamma,
        gae_lambda=ppo.gae_lambda,
        clip_epsilon=ppo.clip_epsilon,
        entropy_coeff=ppo.entropy_coeff / env.model.nu,
        hidden=(len(config.obs) * network.width, *network.hidden),
    )
    env.close()
    return Robot(name, path, ours)


def run_side(side: str, robot: Robot, seed: int, limits: Limits) -> Run:
    """Lets a side learn in a process of its own, which is ended when its time is over.

    Args:
        side: its name.
        robot: what it learns with.
        seed: of everything that is random.
        limits: what it may use.

    Raises:
        SideFailed: if the side ended by itself before it was done.
    """
    run = Run(side, robot.name, seed)
    with tempfile.TemporaryDirectory(prefix="time_to_gait_") as folder:
        task = Task(
            side=side,
            robot=robot.name,
            model=str(robot.model),
            seed=seed,
            spawned=time.time(),
            output=str(Path(folder, "iterations")),
            folder=folder,
            ours=robot.ours,
        )
        log = Path(folder, "log")
        status = _watch(task, limits, log)
        if status == MISSING_PACKAGE:
            run.missing = (_lines(log) or ["a package"])[-1]
        elif status not in (None, 0):
            said = "\n".join(_lines(log)[-20:])
            raise SideFailed(f"{side} on {robot.name} ended with status {status}:\n{said}")
        rows = _rows(Path(task.output))
        run.rows = [row for row in rows if row["seconds"] <= limits.seconds]
    return run


def _watch(task: Task, limits: Limits, log: Path) -> int | None:
    """Runs a side until it or its time has ended; returns its exit status if it ended by itself."""
    environ = {
        **os.environ,
        "TMPDIR": task.folder,
        "OMP_NUM_THREADS": str(limits.threads),
    }
    with open(log, "wb") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.gait_sides", json.dumps(dataclasses.asdict(task))],
            stdout=said,
            stderr=said,
            env=environ,
            start_new_session=True,  # its own processes end with it
        )
    try:
        while process.poll() is None and time.time() - task.spawned < limits.seconds:
            if limits.iterations and len(_rows(Path(task.output))) >= limits.iterations:
                break
            time.sleep(LOOK)
        return process.poll()
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def bare_seconds(robot: Robot, robots: int, steps: int) -> float:
    """The time that bare MuJoCo takes for control steps of a robot under random targets (s).

    Args:
        robot: the robot.
        robots: copies, which all cores step together with ``mujoco.batch``.
        steps: control steps of each, with targets that are uniform in ±1 rad.
    """
    model = mujoco.MjModel.from_binary_path(str(robot.model))
    substeps = round(CONTROL_TIMESTEP / model.opt.timestep)
    batch = BareBatch(model, robots, substeps, usable_cores())
    settling = round(SETTLE_TIME / CONTROL_TIMESTEP)
    targets = np.random.default_rng(0).uniform(-1, 1, (settling + steps, robots, model.nu))
    rest = np.concatenate([np.zeros(1), model.qpos0, np.zeros(model.nv)])
    start, _ = batch.replay(np.tile(rest, (robots, 1)), targets[:settling])
    return batch.replay(start, targets[settling:])[1]


def _rows(path: Path) -> list[dict[str, float]]:
    """All iterations that have been written completely."""
    if not path.is_file():
        return []
    return [json.loads(line) for line in path.read_text().splitlines(True) if line.endswith("\n")]


def _lines(path: Path) -> list[str]:
    return [line for line in path.read_text(errors="replace").splitlines() if line.strip()]
