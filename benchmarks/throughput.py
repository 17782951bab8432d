"""What the framework costs and what it saves: ``python -m benchmarks.throughput``.

Results are ratios of two sides that take turns within one run, so that a noisy machine is noisy to
both: the median of the ratios of neighbouring turns, beside the smallest and the largest. Only memory
and how far two simulations come apart are absolute.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from tqdm import trange

from benchmarks.report import Row, load, machine, table, usable_cores

if TYPE_CHECKING:
    from benchmarks.ours import Training

# Processes that are started import this module again, so what is heavy is imported where it is used:
# nobody's memory shall hold what they do not need.

DESCRIPTION = "Measures what the framework costs and what it saves, as ratios in one table."

NOTES = """\
Sides of a ratio take turns. Collector: environment, transforms, policy and storage, as in training.
Rivals: one process a robot, stepping the same compiled model; they are driven by precomputed random
actions without a policy and store nothing, which is kinder to them. Memory: peak of the proportional
set size, summed over all processes; training collects and learns, rivals only step."""


@dataclasses.dataclass(frozen=True)
class Effort:
    """How much is measured.

    Attributes:
        turns: of both sides of a ratio.
        rivals: processes of a rival, and our robots beside it.
        scale: numbers of robots; the first is what the others are compared to.
        most: robots whose memory is measured.
    """

    turns: int
    rivals: int
    scale: tuple[int, ...]
    most: int


FULL = Effort(turns=11, rivals=64, scale=(64, 256, 1024, 4096), most=4096)
QUICK = Effort(turns=2, rivals=4, scale=(64, 256), most=256)


def main() -> None:
    """Measures what the command line asks for, and prints the table."""
    parser = _Parser(prog="python -m benchmarks.throughput", description=DESCRIPTION)
    parser.add_argument(
        "--quick", action="store_true", help="few turns and robots, only to see that it runs"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results there too")
    parser.add_argument(
        "--only", nargs="+", choices=SECTIONS, default=list(SECTIONS), help="what to measure"
    )
    arguments = parser.parse_args()
    if arguments.json is not None:
        try:
            arguments.json.touch()
        except OSError as error:
            parser.error(f"--json {arguments.json}: {error.strerror}")
    # Without a screen, dm-control warns in every process that imports it.
    os.environ.setdefault("MUJOCO_GL", "disabled")

    started = time.perf_counter()
    about = {**machine(), "load at the start": load()}
    effort = QUICK if arguments.quick else FULL
    rows = [row for name in arguments.only for row in SECTIONS[name](effort)]
    about |= {"load at the end": load(), "seconds": f"{time.perf_counter() - started:.0f}"}
    print(*(f"{name}: {value}" for name, value in about.items()), sep="\n", end="\n\n")
    print(table(rows), NOTES, sep="\n\n")
    if arguments.quick:
        print("--quick: a smoke test, whose numbers mean nothing.")
    if arguments.json is not None:
        results = {
            "machine": about,
            "quick": arguments.quick,
            "rows": [row.record() for row in rows],
        }
        arguments.json.write_text(json.dumps(results, indent=2) + "\n")


def measure_limit(effort: Effort) -> Iterator[Row]:
    """Frames a second of training's collector beside ``mujoco.rollout`` alone.

    The raw rollout replays each batch: from the states in which it began, under the actions that
    were taken. So both sides do the same physics, which the last row makes sure of.
    """
    from benchmarks.ours import RawRollout, state_of

    apart = 0.0
    for num_envs, steps, target in ((64, 128, 0.95), (1024, 8, 0.98)):
        threads = usable_cores()
        training = _warm_training(num_envs, steps, f"physics.threads={threads}")
        raw = RawRollout(training.model, num_envs, training.substeps, threads)
        ours, limit = [], []
        for _ in _turns(effort.turns, f"limit, {num_envs} robots"):
            start = state_of(training.env)
            batch, elapsed = training.collect()
            ours.append(training.frames / elapsed)
            end, elapsed = raw.replay(start, training.controls(batch))
            limit.append(training.frames / elapsed)
            apart = max(apart, float(abs(end - state_of(training.env))[:, 1:].max()))
        raw.close()
        training.close()
        yield Row(
            f"frames/s, collector / raw mujoco.rollout, {num_envs} robots",
            _ratios(ours, limit),
            target,
            context=_medians("{:,.0f}", ours, limit) + " frames/s",
        )
    yield Row("states, collector - raw, largest difference", [apart], 0.0, True, "{:.0e}")


def measure_rivals(effort: Effort) -> Iterator[Row]:
    """Frames a second and memory beside what a user would pick, in processes of their own."""
    from benchmarks.ours import CollectorSide, Training
    from benchmarks.rivals import RIVALS
    from benchmarks.workers import Worker, can_measure_memory

    training = Training(1, 1)
    model = training.model
    training.close()
    num_envs, steps = effort.rivals, 32
    memory = []
    with Worker(CollectorSide, num_envs, steps, False) as us:
        us.rate()
        for name, (side, target) in RIVALS.items():
            row = Row(f"frames/s, collector / {name}({num_envs})", [], target)
            try:
                with Worker(side, model, num_envs, steps) as rival:
                    rival.rate()
                    turns = _turns(effort.turns, f"{name}({num_envs})")
                    ours, theirs = zip(*((us.rate(), rival.rate()) for _ in turns), strict=True)
                    if can_measure_memory():
                        peak = rival.peak_memory()
                        memory.append(Row(f"peak memory (GB), {name}({num_envs})", [peak]))
                row.values = _ratios(ours, theirs)
                row.context = _medians("{:,.0f}", ours, theirs) + " frames/s"
            except ModuleNotFoundError as error:
                row.context = f"needs {error.name}: pip install '.[benchmarks]'"
            yield row
    yield from memory
    for robots, target, overrides in (
        (num_envs, 1.0, ()),
        # A control step of one physics step instead of 25, which would take minutes. What MuJoCo
        # notes of the other 24, 25 MB for 4096 robots, is left out.
        (effort.most, 2.0, ("env.control_frequency=100",)),
    ):
        row = Row(f"peak memory (GB), training, {robots} robots x 128 steps", [], target, True)
        if can_measure_memory():
            with Worker(CollectorSide, robots, 128, True, *overrides) as us:
                for _ in _turns(1, f"memory, {robots} robots"):
                    row.values = [us.peak_memory()]
        else:
            row.context = "needs Linux's /proc"
        yield row


def measure_step(effort: Effort) -> Iterator[Row]:
    """Time of a physics step beside the same robot under MuJoCo's plain defaults.

    On one thread, from the same states in contact, under the same controls.
    """
    from benchmarks.ours import RawRollout, plain_model, state_of, with_numerics_of

    for robot in ("gecko", "ant"):
        training = _warm_training(64, 8, f"robot={robot}")
        model, substeps = training.model, training.substeps
        plain = plain_model(training.env.base_env.task)
        shipped, unfused, alike = (
            RawRollout(side, 64, substeps, threads=1)
            for side in (model, plain, with_numerics_of(plain, model))
        )
        ours, theirs = [], []
        for _ in _turns(effort.turns, f"physics step, {robot}"):
            start = state_of(training.env)
            controls = training.controls(training.collect()[0])
            microseconds = 1e6 / (training.frames * substeps)
            ours.append(microseconds * shipped.replay(start, controls)[1])
            theirs.append(microseconds * unfused.replay(start, controls)[1])
        yield Row(
            f"time of a physics step, shipped / plain model, {robot}",
            _ratios(ours, theirs),
            0.7,
            True,
            context=_medians("{:.1f}", ours, theirs) + f" us; {model.nbody}, {plain.nbody} bodies",
        )
        second = controls[: round(1 / (substeps * model.opt.timestep))]
        end = shipped.replay(start, second)[0]
        for other, which in ((unfused, "plain"), (alike, "plain, numerics alike")):
            apart = abs(end - other.replay(start, second)[0])[:, 1 : 1 + model.nq].max(axis=1)
            yield Row(
                f"qpos after 1 s, shipped - {which}, largest difference, {robot}",
                [float(apart.max())],
                1e-9,
                True,
                "{:.0e}",
                f"median of 64 robots {statistics.median(apart):.0e}",
            )
        for closed in (shipped, unfused, alike, training):
            closed.close()


def measure_update(effort: Effort) -> Iterator[Row]:
    """Share of an iteration that goes into learning from 8,192 frames."""
    training = _warm_training(64, 128)
    learning, iteration = [], []
    for _ in _turns(effort.turns, "update"):
        batch, collecting = training.collect()
        learning.append(training.update(batch))
        iteration.append(learning[-1] + collecting)
    training.close()
    yield Row(
        "time, PPO.update / iteration, 64 robots x 128 steps",
        _ratios(learning, iteration),
        0.05,
        True,
        "{:.1%}",
        _medians("{:.2f}", learning, iteration) + " s",
    )


def measure_scale(effort: Effort) -> Iterator[Row]:
    """Time of a robot's control step with more robots, and with more threads."""
    trainings = {
        num_envs: _warm_training(num_envs, max(4, 4096 // num_envs)) for num_envs in effort.scale
    }
    times = _time_frames(trainings, effort.turns, "more robots")
    first, *others = effort.scale
    for num_envs in others:
        yield Row(
            f"time of a robot's step, {num_envs} / {first} robots",
            _ratios(times[num_envs], times[first]),
            1.0,
            True,
            context=_medians("{:.0f}", times[num_envs], times[first]) + " us",
        )
    for num_envs in (64, 1024):
        row = Row(f"frames/s, 2 threads / 1, {num_envs} robots", [], 1.8)
        bare = Row(f"the same, mujoco.rollout alone, {num_envs} robots", [])
        if usable_cores() > 1:
            steps = 4096 // num_envs
            trainings = {
                threads: _warm_training(num_envs, steps, f"physics.threads={threads}")
                for threads in (1, 2)
            }
            times = _time_frames(trainings, effort.turns, f"2 threads, {num_envs} robots")
            row.values = _ratios(times[1], times[2])
            row.context = _medians("{:.0f}", times[2], times[1]) + " us a robot's step"
            bare.values = _bare_speedups(num_envs, steps, effort.turns)
        else:
            row.context = "needs two cores"
        yield row
        yield bare


def _bare_speedups(num_envs: int, steps: int, turns: int) -> list[float]:
    """How many times faster ``mujoco.rollout`` alone is with two threads than with one."""
    from benchmarks.ours import RawRollout, state_of

    training = _warm_training(num_envs, steps)
    start = state_of(training.env)
    controls = training.controls(training.collect()[0])
    one, two = (
        RawRollout(training.model, num_envs, training.substeps, threads) for threads in (1, 2)
    )
    speedups = [
        one.replay(start, controls)[1] / two.replay(start, controls)[1]
        for _ in _turns(turns, f"2 threads, {num_envs} robots, bare")
    ]
    for closed in (one, two, training):
        closed.close()
    return speedups


SECTIONS: dict[str, Callable[[Effort], Iterable[Row]]] = {
    "limit": measure_limit,
    "rivals": measure_rivals,
    "step": measure_step,
    "update": measure_update,
    "scale": measure_scale,
}


def _warm_training(num_envs: int, steps: int, *overrides: str) -> Training:
    """Training after its first batch, which takes longer than any other."""
    from benchmarks.ours import Training

    training = Training(num_envs, steps, *overrides)
    training.collect()
    return training


def _time_frames(trainings: dict[int, Training], turns: int, label: str) -> dict[int, list[float]]:
    """Time (us) of a robot's control step in each training, which take turns and are closed."""
    import torch

    times: dict[int, list[float]] = {key: [] for key in trainings}
    for turn in _turns(turns, label):
        for key, training in trainings.items():
            torch.manual_seed(turn)  # trainings of as many robots walk the same way
            times[key].append(1e6 * training.collect()[1] / training.frames)
    for training in trainings.values():
        training.close()
    return times


def _turns(count: int, label: str) -> Iterable[int]:
    return trange(count, desc=label, leave=False)


def _ratios(over: Sequence[float], under: Sequence[float]) -> list[float]:
    return [a / b for a, b in zip(over, under, strict=True)]


def _medians(form: str, first: Sequence[float], second: Sequence[float]) -> str:
    return f"{form} and {form}".format(statistics.median(first), statistics.median(second))


class _Parser(argparse.ArgumentParser):
    """Answers mistakes in one line, as the package's other commands do."""

    def error(self, message: str) -> NoReturn:
        print(f"error: {message}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
