"""What a run leaves behind: one row of metrics an iteration, and checkpoints."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from locomotion.config import LoggerBackend, LoggerConfig


class MetricsWriter:
    """Appends rows to ``metrics.csv``, each on disk before the next iteration starts.

    Args:
        folder: the run's folder.
        config: where else metrics go.
    """

    def __init__(self, folder: Path, config: LoggerConfig) -> None:
        self._file = (folder / "metrics.csv").open("w")
        self._columns: list[str] | None = None
        self._logger = None
        if config.backend is LoggerBackend.tensorboard:
            from torchrl.record.loggers.tensorboard import TensorboardLogger

            self._logger = TensorboardLogger(exp_name="tensorboard", log_dir=str(folder))

    def write(self, row: Mapping[str, float]) -> None:
        """Adds one row; the first one decides the columns."""
        if self._columns is None:
            self._columns = list(row)
            self._file.write(",".join(self._columns) + "\n")
        self._file.write(",".join(f"{row[column]:.9g}" for column in self._columns) + "\n")
        self._file.flush()
        if self._logger is not None:
            self._logger.log_metrics(dict(row), step=int(row["frames"]))

    def close(self) -> None:
        self._file.close()


def save_checkpoint(path: Path, state: Mapping[str, Any]) -> None:
    """Writes a checkpoint whole or not at all."""
    path.parent.mkdir(exist_ok=True)
    partial = path.with_suffix(".partial")
    with partial.open("wb") as file:
        torch.save(dict(state), file)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)
