"""Puts the policy of a finished run among those that come along.

``python -m benchmarks.pack_policy RUN`` writes ``locomotion/data/policies/ROBOT``: the run's
configuration, and a checkpoint that holds the actor alone.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

from omegaconf import OmegaConf

from locomotion.assembly import make_env
from locomotion.command_line.policies import POLICIES
from locomotion.config import Config, ConfigError, typed
from locomotion.gaits import load_policy
from locomotion.runs import RunError, read_config, record
from locomotion.runs.checkpoints import Checkpoints


def pack(run: Path) -> Path:
    """Packs the policy of a run's last checkpoint; returns the folder it is in."""
    config = typed(Config, read_config(run))
    policy = load_policy(run, config, make_env(config))
    folder = POLICIES / config.robot.name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    record(folder, config=OmegaConf.structured(config))
    Checkpoints(folder, actor=policy).save(config.ppo.iterations)
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pack_policy", description=__doc__)
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a finished run")
    try:
        print(pack(parser.parse_args().run))
    except (ConfigError, RunError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
