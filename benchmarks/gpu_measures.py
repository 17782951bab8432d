"""Measurements of the GPU benchmark, in processes of their own."""

from __future__ import annotations

import csv
import dataclasses
import multiprocessing
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

from benchmarks.rows import Row

#: The report's budget of control steps.
BUDGET = 64 * 128 * 200
#: The reward (m) that its Gecko ends with.
REPORTED = 0.087


@dataclasses.dataclass(frozen=True)
class Effort:
    """The amount that is measured.

    Attributes:
        turns: batches that are timed.
        steps: control steps of each robot in a batch.
        robots: numbers of robots.
        rivals: robots stepped by two cores.
        captured: robots with which gradient steps are timed as CUDA graphs, too.
        runs: whole runs: a name, and what is asked for on the command line.
    """

    turns: int
    steps: int
    robots: tuple[int, ...]
    rivals: int
    captured: int
    runs: dict[str, tuple[str, ...]]


FULL = Effort(
    turns=5,
    steps=16,
    robots=(64, 256, 1024, 4096, 16384, 65536),
    rivals=1024,
    captured=4096,
    runs={
        "64 robots, the report's settings": ("+obs=history3", "physics=warp"),
        # 4,096 robots that take 400 control steps each.
        "4,096 robots, the report's budget": (
            "+obs=history3",
            "+experiment=gpu",
            "ppo.iterations=200",
        ),
        "+experiment=gpu": ("+obs=history3", "+experiment=gpu"),
        "+experiment=gpu ppo.cudagraphs=true": (
            "+obs=history3",
            "+experiment=gpu",
            "ppo.cudagraphs=true",
        ),
    },
)
QUICK = Effort(
    turns=2,
    steps=2,
    robots=(4, 8),
    rivals=8,
    captured=8,
    runs={
        "8 robots, little of a run": (
            "physics=warp",
            "env.num_envs=8",
            "ppo.steps=4",
            "ppo.minibatch_size=32",
            "ppo.iterations=2",
        )
    },
)


def apart(measure: Callable[..., Any], *arguments: Any) -> Any:
    """Calls a function, and returns what it returns, in a process of its own, whose memory nobody else has used."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        return pool.submit(measure, *arguments).result()


def measure_training(
    num_envs: int, effort: Effort, device: str, *overrides: str
) -> dict[str, list[float] | float]:
    """Collects and learns.

    Returns:
        Turn by turn, ``speed`` (control steps of all robots a second) and the time (s) of a control
        step ``bare`` (on Warp), to ``collect`` and to ``update``; and ``memory``, in bytes.
    """
    from locomotion.quiet import quiet

    with quiet():
        return _measure_training(num_envs, effort, device, overrides)


def _measure_training(
    num_envs: int, effort: Effort, device: str, overrides: tuple[str, ...]
) -> dict[str, list[float] | float]:
    import torch

    from benchmarks.bare import BareWarp
    from benchmarks.ours import Training

    def finish() -> float:
        if device != "cpu":
            torch.cuda.synchronize(device)
        return time.perf_counter()

    free = torch.cuda.mem_get_info(device)[0] if device != "cpu" else 0
    training = Training(num_envs, effort.steps, *overrides)
    physics = training.env.base_env.physics
    bare = BareWarp(physics, training.substeps) if "physics=warp" in overrides else None
    batch, _ = training.collect()
    training.update(batch)  # the first ones take longer
    times: dict[str, list[float]] = {"bare": [], "collect": [], "update": []}
    for _ in range(effort.turns):
        qpos, qvel = physics.qpos.clone(), physics.qvel.clone()
        started = finish()
        batch, _ = training.collect()
        times["collect"].append((finish() - started) / effort.steps)
        if bare is not None:
            bare.load(qpos, qvel)
            started = finish()
            bare.replay(batch["action"])
            times["bare"].append((finish() - started) / effort.steps)
        started = finish()
        training.update(batch)
        times["update"].append((finish() - started) / effort.steps)
    used = free - torch.cuda.mem_get_info(device)[0] if device != "cpu" else 0
    training.close()
    return {
        "speed": [num_envs / seconds for seconds in times["collect"]],
        "memory": used,
        **times,
    }


def measure_run(name: str, overrides: tuple[str, ...], device: str) -> Row:
    """Wall time (s) of a whole run, and the reward that it ended with."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "locomotion.train", *overrides]
        command += [f"physics.device={device}", f"hydra.run.dir={folder}/run"]
        started = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True)
        seconds = time.perf_counter() - started
        if done.returncode:
            return Row(f"s, whole run, {name}", [], context=done.stderr.strip().splitlines()[-1])
        with open(f"{folder}/run/metrics.csv", newline="") as file:
            rows = list(csv.DictReader(file))
    steps, rewards = int(rows[-1]["frames"]), [float(row["mean_reward"]) for row in rows]
    # For good: as long as all robots still face the way they started, a policy can be faster than it is.
    below = [i for i, reward in enumerate(rewards) if reward < REPORTED]
    there = below[-1] + 1 if below else 0
    taken = [float(row["collect_seconds"]) + float(row["update_seconds"]) for row in rows]
    passed = "never" if there == len(rows) else f"after {sum(taken[: there + 1]):.1f} s of training"
    return Row(
        f"s, whole run, {name}",
        [seconds],
        target=60.0 if steps == BUDGET else None,
        at_most=True,
        form="{:.1f}",
        context=(
            f"{steps:,} control steps, {statistics.mean(rewards[-10:]):.3f} m at the end;"
            f" {REPORTED} m for good {passed}"
        ),
    )
