"""The configuration of a run whose policy is looked at."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from locomotion.config import Config
from locomotion.disturbances import NONE
from locomotion.runs import read_config, typed_record


def load_config(run: Path) -> Config:
    """Reads what a run was trained with; its plugins are not imported, as a folder may be a stranger's.

    Args:
        run: the run's folder.

    Raises:
        RunError: if the folder does not hold a run.
        ConfigError: if it is one of another version.
    """
    return typed_record(read_config(run))


def walking_config(run: Path, num_envs: int) -> Config:
    """The task of a run for walking: undisturbed and without a time limit. Raises as :func:`load_config`.

    Args:
        run: the run's folder.
        num_envs: number of robots.
    """
    config = load_config(run)
    env = dataclasses.replace(config.env, num_envs=num_envs, time_limit=None, stagger=False)
    return dataclasses.replace(config, env=env, disturbances=NONE)
