"""What limbs that collide cost a gait, and what training with them brings.

``python -m benchmarks.self_collision FOLDER ...`` walks the policies of all runs below some folders, each
where limbs pass through one another and where they collide, with the policy's mean action, and prints a
table in Markdown.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from omegaconf import OmegaConf
from tqdm import tqdm

from benchmarks.claims import table
from locomotion.command_line.quiet import quiet
from locomotion.config import Config, ConfigError, typed
from locomotion.gaits import Interval, make_walker, measure, summarise, walk
from locomotion.plots.curves import find_runs
from locomotion.runs import RunError, read_config

NUM_ENVS, SECONDS = 64, 60.0
HEAD = [
    *("robot", "trained with limbs that", "seed", "walks with limbs that"),
    *("speed (m/s)", "straightness", "rolls over per metre", "on its back"),
]


def rows(run: Path) -> list[list[str]]:
    """How a run's policy walks in both worlds, a row each."""
    saved = OmegaConf.create(read_config(run))
    saved.env.num_envs = NUM_ENVS
    saved.ppo.update(steps=1, minibatch_size=1)  # nothing learns here
    config = typed(Config, saved)
    trained = config.physics.self_collision
    found = []
    for collide in (False, True):
        config.physics.self_collision = collide
        walker = make_walker(run, config)
        values = summarise(measure(walk(walker, SECONDS, effort=True)))
        walker.env.close()
        shown = [_shown(values[name]) for name in ("speed", "straightness", "rolls_per_metre")]
        words = [("collide" if which else "pass") for which in (trained, collide)]
        on_back = f"{values['on_back'].mean:.0%}"
        found.append([config.robot.name, words[0], str(config.seed), words[1], *shown, on_back])
    return found


def _shown(interval: Interval) -> str:
    return f"{interval.mean:.3f} [{interval.low:.3f}, {interval.high:.3f}]"


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.self_collision", description=__doc__
    )
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    quiet()
    try:
        runs = [run for folder in parser.parse_args().folders for run in find_runs(folder)]
        found = sorted(row for run in tqdm(runs, unit="run", disable=None) for row in rows(run))
    except (ConfigError, RunError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    print(*table(HEAD, found), sep="\n")


if __name__ == "__main__":
    main()
