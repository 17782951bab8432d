"""The cost of limbs that collide to a gait, and the gain of training with them.

``python -m reproduction.self_collision FOLDER ...`` walks the policies of all runs below some folders, each
where limbs pass through one another and where they collide, with the policy's mean action, and prints a
table in Markdown.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from tqdm import tqdm

from locomotion.cli.refusal import refusing
from locomotion.plots.curves import find_runs
from locomotion.quiet import quiet
from reproduction.claims import table
from reproduction.runs import walking_config

if TYPE_CHECKING:
    from locomotion.evaluation import Interval

NUM_ENVS, SECONDS = 64, 60.0
HEAD = [
    *("robot", "trained with limbs that", "seed", "walks with limbs that"),
    *("speed (m/s)", "straightness", "rolls over per metre", "on its back"),
]


def rows(run: Path, num_envs: int, seconds: float) -> list[list[str]]:
    """Walks with a run's policy in both worlds, a row each."""
    from locomotion.evaluation import make_runner, measure, summarise, walk

    config = walking_config(run, num_envs)
    trained, found = config.physics.self_collision, []
    for collide in (False, True):
        config.physics = dataclasses.replace(config.physics, self_collision=collide)
        runner = make_runner(run, config)
        values = summarise(measure(walk(runner, seconds, effort=True)))
        runner.env.close()
        shown = [_shown(values[name]) for name in ("speed", "straightness", "rolls_per_metre")]
        words = ["collide" if which else "pass" for which in (trained, collide)]
        on_back = f"{values['on_back'].mean:.0%}"
        found.append([config.robot.name, words[0], str(config.seed), words[1], *shown, on_back])
    return found


def _shown(interval: Interval) -> str:
    return f"{interval.mean:.3f} [{interval.low:.3f}, {interval.high:.3f}]"


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m reproduction.self_collision", description=__doc__
    )
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--robots", type=int, default=NUM_ENVS, metavar="NUMBER")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="how long they walk")
    arguments = parser.parse_args()
    with refusing(), quiet():
        runs = find_runs(arguments.folders)
        found = [
            row
            for run in tqdm(runs, unit="run", disable=None)
            for row in rows(run, arguments.robots, arguments.seconds)
        ]
    print(*table(HEAD, sorted(found)), sep="\n")


if __name__ == "__main__":
    main()
