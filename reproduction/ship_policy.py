"""Puts the policy of a finished run among those that ship.

``python -m reproduction.ship_policy RUN`` writes ``locomotion/data/policies/ROBOT``: the run's
configuration, and a checkpoint that holds the policy alone.
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
from pathlib import Path

from locomotion.cli.refusal import refusing
from locomotion.config import as_dict
from locomotion.evaluation.shipped import POLICIES
from locomotion.quiet import quiet
from locomotion.runs import record
from reproduction.runs import load_config


def ship(run: Path, place: Path) -> Path:
    """Packs the policy of a run's last checkpoint; returns the folder that it is in.

    Args:
        run: the run's folder.
        place: the folder of all policies that ship.
    """
    from locomotion.evaluation import load_policy
    from locomotion.runs.checkpoints import Checkpoints
    from locomotion.training.build import make_env

    config = load_config(run)
    # How many cores trained it is of no matter elsewhere.
    config = dataclasses.replace(config, physics=dataclasses.replace(config.physics, threads=None))
    env = make_env(config)
    policy = load_policy(run, config, env)
    env.close()
    folder = place / config.robot.name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    record(folder, config=as_dict(config))
    Checkpoints(folder, policy=policy).save(config.learner.iterations)
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m reproduction.ship_policy", description=__doc__)
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a finished run")
    parser.add_argument("--output", type=Path, default=POLICIES, metavar="FOLDER")
    arguments = parser.parse_args()
    with refusing(), quiet():
        print(ship(arguments.run, arguments.output))


if __name__ == "__main__":
    main()
