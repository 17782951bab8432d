"""Measurements of the throughput benchmark: each section gives rows of the table."""

from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Callable, Iterable, Iterator, Sequence

import torch
from tqdm import trange

from benchmarks.bare import BareBatch, BareRollout
from benchmarks.ours import PARTS, CollectorSide, Training, controls
from benchmarks.plain import plain_model, undo_savings, with_numerics_of
from benchmarks.rivals import RIVALS
from benchmarks.rows import Row, usable_cores
from benchmarks.workers import Worker, can_measure_memory

#: Robots, control steps in a batch, and the share of bare MuJoCo's speed that training is to have.
SIZES = ((64, 128, 0.90), (1024, 8, 0.97))


@dataclasses.dataclass(frozen=True)
class Effort:
    """The amount that is measured.

    Attributes:
        turns: of both sides of a ratio.
        rivals: processes of a rival, and the number of our robots.
        scale: numbers of robots; the first is what the others are compared to.
        most: robots whose memory is measured.
    """

    turns: int
    rivals: int
    scale: tuple[int, ...]
    most: int


FULL = Effort(turns=11, rivals=64, scale=(64, 256, 1024, 4096), most=4096)
QUICK = Effort(turns=2, rivals=4, scale=(64, 256), most=256)


def measure_limit(effort: Effort) -> Iterator[Row]:
    """Frames a second of training's collector, relative to MuJoCo alone.

    MuJoCo replays each batch: from the states in which it began, under the actions that were taken. So
    all sides do the same physics, which the last row makes sure of.
    """
    apart = 0.0
    for num_envs, steps, target in SIZES:
        training = _warm_training(num_envs, steps)
        made = (training.model, num_envs, training.substeps, usable_cores())
        sides = {"mujoco.rollout": BareRollout(*made), "mujoco.batch": BareBatch(*made)}
        speeds: dict[str, list[float]] = {name: [] for name in ("collector", *sides)}
        for _ in _turns(effort.turns, f"limit, {num_envs} robots"):
            start = training.states()
            batch, elapsed = training.collect()
            speeds["collector"].append(training.frames / elapsed)
            for name, side in sides.items():
                end, elapsed = side.replay(start, controls(batch))
                speeds[name].append(training.frames / elapsed)
                apart = max(apart, float(abs(end - training.states()).max()))
        sides["mujoco.rollout"].close()
        training.close()
        faster = max(sides, key=lambda name: statistics.median(speeds[name]))
        medians = [f"{name} {statistics.median(speed):,.0f}" for name, speed in speeds.items()]
        yield Row(
            f"frames/s, collector / bare MuJoCo, {num_envs} robots",
            _ratios(speeds["collector"], speeds[faster]),
            target,
            context=", ".join(medians),
        )
    yield Row("states, collector - bare, largest difference", [apart], 0.0, True, "{:.0e}")


def measure_parts(effort: Effort) -> Iterator[Row]:
    """Time of a control step that is not MuJoCo's, and what takes it."""
    for num_envs, steps, _ in SIZES:
        training = _warm_training(num_envs, steps)
        bare = BareBatch(training.model, num_envs, training.substeps, usable_cores())
        turns = _turns(effort.turns, f"parts, {num_envs} robots")
        found = [training.parts(bare) for _ in turns]
        training.close()
        medians = {part: 1e3 * statistics.median(turn[part] for turn in found) for part in PARTS}
        yield Row(
            f"ms of a control step outside MuJoCo, {num_envs} robots",
            [1e3 * (sum(turn.values()) - turn["physics"]) for turn in found],
            form="{:.2f}",
            context=", ".join(f"{part} {value:.2f}" for part, value in medians.items()),
        )


def measure_rivals(effort: Effort) -> Iterator[Row]:
    """Frames a second and memory, relative to what a user would pick, in processes of their own."""
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
        # A control step of one physics step instead of 25, which would take minutes.
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
    """Time of a physics step, relative to the same robot under MuJoCo's plain defaults.

    On one thread, from the same states in contact, under the same controls.
    """
    for robot in ("gecko", "ant"):
        training = _warm_training(64, 8, f"robot={robot}")
        model, substeps = training.model, training.substeps
        plain = plain_model(undo_savings(training.env.base_env.task))
        shipped, unfused, alike = (
            BareBatch(side, 64, substeps, threads=1)
            for side in (model, plain, with_numerics_of(plain, model))
        )
        ours, theirs = [], []
        for _ in _turns(effort.turns, f"physics step, {robot}"):
            start = training.states()
            given = controls(training.collect()[0])
            microseconds = 1e6 / (training.frames * substeps)
            ours.append(microseconds * shipped.replay(start, given)[1])
            theirs.append(microseconds * unfused.replay(start, given)[1])
        training.close()
        yield Row(
            f"time of a physics step, shipped / plain model, {robot}",
            _ratios(ours, theirs),
            0.7,
            True,
            context=_medians("{:.1f}", ours, theirs) + f" us; {model.nbody}, {plain.nbody} bodies",
        )
        second = given[: round(1 / (substeps * model.opt.timestep))]
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
        bare = Row(f"the same, mujoco.batch alone, {num_envs} robots", [])
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
    """The speed of MuJoCo alone with two threads, relative to one."""
    training = _warm_training(num_envs, steps)
    start = training.states()
    given = controls(training.collect()[0])
    training.close()
    one, two = (
        BareBatch(training.model, num_envs, training.substeps, threads) for threads in (1, 2)
    )
    return [
        one.replay(start, given)[1] / two.replay(start, given)[1]
        for _ in _turns(turns, f"2 threads, {num_envs} robots, bare")
    ]


#: In the order in which they are measured.
SECTIONS: dict[str, Callable[[Effort], Iterable[Row]]] = {
    "limit": measure_limit,
    "parts": measure_parts,
    "rivals": measure_rivals,
    "step": measure_step,
    "update": measure_update,
    "scale": measure_scale,
}


def _warm_training(num_envs: int, steps: int, *overrides: str) -> Training:
    """Training after its first batch, which takes longer than any other."""
    training = Training(num_envs, steps, *overrides)
    training.collect()
    return training


def _time_frames(trainings: dict[int, Training], turns: int, label: str) -> dict[int, list[float]]:
    """Time (us) of a robot's control step in each training, which take turns and are closed."""
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
