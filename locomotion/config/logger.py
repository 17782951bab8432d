"""Logging: ``logger`` in a configuration."""

from __future__ import annotations

import dataclasses
import enum
import importlib.util

from locomotion.options import Checked, ConfigError, key


class LoggerBackend(enum.Enum):
    """Loggers in addition to ``metrics.csv``, which is always written."""

    csv = "csv"
    tensorboard = "tensorboard"
    wandb = "wandb"


@dataclasses.dataclass
class LoggerConfig(Checked):
    """Options of the logger."""

    PREFIX = "logger."

    backend: LoggerBackend = key(
        "csv: metrics.csv alone; tensorboard or wandb: shown there too",
        default=LoggerBackend.csv,
        free=True,
    )
    video_seconds: float = key(
        "length of the film at the end (s), for tensorboard and wandb; 0: none",
        default=0.0,
        least=0,
        most=3600,
        free=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        name = self.backend.value
        if self.backend is not LoggerBackend.csv and not importlib.util.find_spec(name):
            raise ConfigError(f"logger={name} needs a package: pip install {name}")
        if self.backend is LoggerBackend.csv and self.video_seconds:
            self.refuse("video_seconds", self.video_seconds, "0 with logger=csv, which shows none")
