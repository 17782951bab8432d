"""Modular robots learn to walk: dm-control bodies, batched MuJoCo, TorchRL.

>>> from locomotion import compose, train
>>> result = train(compose("robot=ant", "+obs=history3", "+experiment=quick"), "runs/ant")
>>> result.folder, result.reward
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from locomotion.surroundings import tidy

if TYPE_CHECKING:
    from locomotion.config import Config
    from locomotion.training.execute import Result

tidy()

__all__ = ["compose", "train"]


def compose(*overrides: str, config_dir: Path | str | None = None) -> Config:
    """The configuration that a command line stands for, such as ``compose("robot=ant", "seed=3")``.

    Args:
        overrides: as on the command line of ``python -m locomotion.train``.
        config_dir: a folder with choices of one's own, such as ``robot/mine.yaml``.

    Raises:
        ConfigError: if it cannot be used.
    """
    from locomotion.cli.composing import compose as composed

    return composed(*overrides, config_dir=config_dir)


def train(config: Config, folder: Path | str, **passed: Any) -> Result:
    """Trains a policy in a folder, unless that was done before; see
    :func:`locomotion.training.execute.execute`.
    """
    from locomotion.training.execute import execute

    return execute(config, folder, **passed)
