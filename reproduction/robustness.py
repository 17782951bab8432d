"""Measures what gaits keep under each disturbance, and which observations and training make them keep it.

``python -m reproduction.robustness SWEEP ...`` takes the policy of each run through the reality check, from the start
and with its mean action, and walks it for 20 s from any heading, upright or overturned. It writes
``robustness.csv``, a row for each run and change, and prints a table in Markdown: a column for each way of training,
the mean over seeds. A CSV file in place of a sweep is read, not walked again::

    python -m locomotion.train --multirun robot=gecko,ant +experiment=robust physics.self_collision=true \\
        seed=0,1,2 physics.threads=1 hydra/launcher=parallel hydra.sweep.dir=sweeps/robust
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from tqdm import tqdm

from locomotion.cli.refusal import refusing
from locomotion.disturbances.options import DEFAULTS
from locomotion.plots.observations import observations_name
from locomotion.plots.statistics import mean_interval
from locomotion.quiet import quiet
from locomotion.tasks.options import Start
from reproduction import RESULTS
from reproduction.claims import table
from reproduction.rows import gather
from reproduction.runs import load_config, walking_config

NUM_ENVS, SECONDS, FIRST_SECONDS = 64, 60.0, 20.0
#: Rows that are speeds (m/s); the others are shares of the first.
NOMINAL, ANY_START = "undisturbed (m/s)", "first 20 s from any start (m/s)"


@dataclasses.dataclass(frozen=True)
class Row:
    """A run under one change.

    Attributes:
        robot: its name.
        trained: the observations, and what else tells how it was trained.
        seed: of the run.
        change: in words, or :data:`NOMINAL` or :data:`ANY_START`.
        override: the change as overrides.
        value: share of the undisturbed speed, or a speed (m/s).
    """

    robot: str
    trained: str
    seed: int
    change: str
    override: str
    value: float


def evaluate(run: Path, seconds: float, progress: Callable[[], object]) -> list[Row]:
    """Walks with a run's policy under each change."""
    from locomotion.evaluation import check_robustness, make_runner, measure, walk

    config = walking_config(run, NUM_ENVS)
    runner = make_runner(run, config)
    speeds = measure(walk(runner, seconds, progress=progress))["speed"]
    runner.env.close()
    anyhow = dataclasses.replace(config.env, start=Start.any, overturned=0.5)
    runner = make_runner(run, dataclasses.replace(config, env=anyhow))
    first = measure(walk(runner, FIRST_SECONDS, progress=progress))["speed"]
    runner.env.close()
    checked = check_robustness(run, config, seconds, speeds, progress)
    found = [
        (NOMINAL, "", speeds.nan_to_num(0.0).mean().item()),
        (ANY_START, "", first.nan_to_num(0.0).mean().item()),
        *((share.what, share.override, share.share.mean) for share in checked),
    ]
    trained = _trained(run)
    return [Row(config.robot.name, trained, config.seed, *values) for values in found]


def _trained(run: Path) -> str:
    """The observations of a run, and the disturbances and the ground that it was trained with."""
    config = load_config(run)
    words = [observations_name(config.obs)]
    words += ["disturbed"] if any(map(config.disturbances.active, DEFAULTS)) else []
    words += [config.arena["name"]] if config.arena["name"] != "ground" else []
    words += [config.network["name"]] if config.network["name"] != "mlp" else []
    return ", ".join(words)


def summary(rows: Sequence[Row]) -> list[str]:
    """A table for each robot: changes as rows, ways of training as columns."""
    lines = []
    for robot in dict.fromkeys(row.robot for row in rows):
        own = [row for row in rows if row.robot == robot]
        ways = list(dict.fromkeys(row.trained for row in own))
        changes = {row.change: row.override for row in own}
        body = [
            [
                change,
                f"`{override}`" if override else "",
                *(_cell(own, way, change) for way in ways),
            ]
            for change, override in changes.items()
        ]
        lines += [f"**{robot}**", "", *table([robot, "", *ways], body), ""]
    return lines


def _cell(rows: Sequence[Row], way: str, change: str) -> str:
    values = [row.value for row in rows if (row.trained, row.change) == (way, change)]
    if not values:
        return ""
    mean, low, high = mean_interval(values)
    form = ".2f" if change in (NOMINAL, ANY_START) else ".0%"
    between = f" [{low:{form}}, {high:{form}}]" if len(values) > 1 else ""
    return f"{mean:{form}}{between}"


def _measured(runs: Sequence[Path], seconds: float) -> Iterator[Row]:
    with tqdm(desc="control steps", unit="step", disable=None) as bar:
        for run in runs:
            yield from evaluate(run, seconds, bar.update)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m reproduction.robustness",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("sources", nargs="+", type=Path, metavar="SWEEP")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="how long they walk")
    parser.add_argument("--output", type=Path, default=RESULTS / "robustness.csv", metavar="FILE")
    arguments = parser.parse_args()
    with refusing(), quiet():
        rows = gather(
            Row,
            arguments.sources,
            lambda runs: _measured(runs, arguments.seconds),
            arguments.output,
        )
    print(*summary(rows), sep="\n")


if __name__ == "__main__":
    main()
