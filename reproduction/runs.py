"""The configuration of a run whose policy is looked at."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from locomotion.config import Config
from locomotion.runs import read_config, typed_record


def load_config(run: Path, num_envs: int | None = None) -> Config:
    """Reads what a run was trained with; its plugins are not imported, as a folder may be a stranger's.

    Args:
        run: the run's folder.
        num_envs: robots, in place of as many as in training.

    Raises:
        RunError: if the folder does not hold a run.
        ConfigError: if it is one of another version.
    """
    config = typed_record(read_config(run))
    if num_envs is not None:
        config.env = dataclasses.replace(config.env, num_envs=num_envs)
    return config
