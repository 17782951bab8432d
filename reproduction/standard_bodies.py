"""Measures how well one setting serves Revolve2's standard bodies, from the runs of a sweep.

``python -m reproduction.standard_bodies SWEEP ...`` walks the policy of each run from the start, with its
mean action: once from the pose that training starts in, and once from any heading, upright or overturned. It
writes ``standard_bodies.csv``, a row a run, and prints a table in Markdown, a row a body. A CSV file in place of
a sweep is read, not walked again::

    python -m locomotion.train --multirun 'robot=glob(*,exclude=random)' +obs=history3 +experiment=quick seed=0,1,2 \\
        physics.threads=1 hydra/launcher=parallel hydra.sweep.dir=sweeps/bodies
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import fmean

from tqdm import tqdm

from locomotion.cli.refusal import refusing
from locomotion.config import Config
from locomotion.plots.curves import read_metrics
from locomotion.quiet import quiet
from locomotion.tasks.options import Start
from reproduction import RESULTS
from reproduction.claims import table
from reproduction.rows import gather
from reproduction.runs import walking_config

#: Left out while the setting was searched for.
HELD_BACK = ("babyb", "garrix", "linkin", "penguin", "queen")
NUM_ENVS, SECONDS = 64, 60.0
HEAD = [
    *("body", "hinges", "reward (m)", "speed over 60 s (m/s)", "first 20 s", "after that"),
    *("first 20 s from any start", "diverged in training"),
]


@dataclasses.dataclass(frozen=True)
class Row:
    """A run: what it earned, and how fast its policy walks (m/s).

    Attributes:
        robot: its name.
        seed: of the run.
        hinges: of the robot.
        reward: mean of the last ten iterations (m per action).
        diverged: robots whose simulation diverged, over the whole training.
        speed: distance over time of the whole walk, mean of all robots.
        first: the same for the first 20 s.
        steady: the same for what comes after these.
        first_from_any: for the first 20 s from any heading, upright or overturned.
    """

    robot: str
    seed: int
    hinges: int
    reward: float
    diverged: int
    speed: float
    first: float
    steady: float
    first_from_any: float


def evaluate(run: Path) -> Row:
    """Walks with a run's policy."""
    metrics = read_metrics(run)
    config = walking_config(run, NUM_ENVS)
    upright = _speeds(run, config, Start.upright)
    anyhow = _speeds(run, config, Start.any)
    return Row(
        robot=config.robot.name,
        seed=config.seed,
        hinges=int(upright["hinges"]),
        reward=float(metrics["mean_reward"][-10:].mean()),
        diverged=int(metrics["diverged"].sum()),
        speed=upright["speed"],
        first=upright["first_speed"],
        steady=upright["steady_speed"],
        first_from_any=anyhow["first_speed"],
    )


def _speeds(run: Path, config: Config, start: Start) -> dict[str, float]:
    from locomotion.evaluation import make_runner, measure, walk

    config.env = dataclasses.replace(config.env, start=start, overturned=0.5)
    runner = make_runner(run, config)
    found = measure(walk(runner, SECONDS))
    hinges = float(len(runner.base_env.hinge_names))
    runner.env.close()
    # A robot whose simulation diverged counts as one that stood still.
    return {name: value.nan_to_num(0.0).mean().item() for name, value in found.items()} | {
        "hinges": hinges
    }


def summary(rows: Sequence[Row]) -> list[str]:
    """The table, and the means over bodies."""
    bodies = {row.robot: [r for r in rows if r.robot == row.robot] for row in rows}
    ranked = sorted(bodies.values(), key=lambda runs: -fmean(run.speed for run in runs))
    lines = table(HEAD, [_cells(runs) for runs in ranked])
    for name, chosen in (
        ("all bodies", [*bodies.values()]),
        ("held back", [runs for robot, runs in bodies.items() if robot in HELD_BACK]),
        ("searched on", [runs for robot, runs in bodies.items() if robot not in HELD_BACK]),
    ):
        if chosen:
            means = [fmean(run.speed for run in runs) for runs in chosen]
            start = _mean(chosen, "first") / _mean(chosen, "steady")
            any_start = _mean(chosen, "first_from_any") / _mean(chosen, "steady")
            line = f"{len(means)} {name}: {fmean(means):.2f} m/s on average, the slowest {min(means):.2f}"
            line += f"; over the first 20 s {start:.0%} of the speed after that, from any start"
            lines += ["", f"{line} {any_start:.0%}."]
    return lines


def _mean(bodies: Sequence[Sequence[Row]], name: str) -> float:
    return fmean(fmean(getattr(run, name) for run in runs) for runs in bodies)


def _cells(runs: Sequence[Row]) -> list[str]:
    def shown(name: str, digits: int = 2) -> str:
        values = [getattr(run, name) for run in runs]
        spread = f" ({min(values):.{digits}f} to {max(values):.{digits}f})" if values[1:] else ""
        return f"{fmean(values):.{digits}f}{spread}"

    speeds = [shown(name) for name in ("speed", "first", "steady", "first_from_any")]
    return [
        *(runs[0].robot, str(runs[0].hinges), shown("reward", 3), *speeds),
        str(sum(run.diverged for run in runs)),
    ]


def _measured(runs: Sequence[Path]) -> Iterator[Row]:
    return map(evaluate, tqdm(runs, unit="run", disable=None))


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m reproduction.standard_bodies",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("sources", nargs="+", type=Path, metavar="SWEEP")
    parser.add_argument(
        "--output", type=Path, default=RESULTS / "standard_bodies.csv", metavar="FILE"
    )
    arguments = parser.parse_args()
    with refusing(), quiet():
        rows = gather(Row, arguments.sources, _measured, arguments.output)
    print(*summary(rows), sep="\n")


if __name__ == "__main__":
    main()
