"""The metrics of a run, one row an iteration."""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from locomotion.envs import Divergence
from locomotion.runs import RunError
from locomotion.writing import atomic_write, sync


class MetricsWriter:
    """Appends rows to ``metrics.csv``, each whole or not at all.

    Args:
        folder: the run's folder.
        rows: how many rows to keep of those that are there; the others are removed.

    Raises:
        RunError: if there are fewer rows.
    """

    def __init__(self, folder: Path, rows: int = 0) -> None:
        path = folder / "metrics.csv"
        self._columns: list[str] | None = None
        if rows:
            lines = path.read_bytes().splitlines(keepends=True) if path.is_file() else []
            if len(lines) < 1 + rows or not lines[rows].endswith(b"\n"):
                raise RunError(f"{path} has lost rows: the checkpoint was written after {rows}")
            self._columns = lines[0].decode(errors="replace").strip().split(",")
        else:
            lines = []
        with atomic_write(path) as partial:
            partial.write_bytes(b"".join(lines[: 1 + rows]))
        # Without a buffer, whose content would be tried again when the file is closed.
        self._file = path.open("ab", buffering=0)

    def write(self, row: Mapping[str, float]) -> None:
        """Adds one row; the first one decides the columns, and what a later one lacks is nan."""
        line = (
            ",".join(f"{row.get(column, math.nan):.9g}" for column in self._columns or row) + "\n"
        )
        if self._columns is None:
            self._columns = list(row)
            line = ",".join(self._columns) + "\n" + line
        whole = self._file.tell()
        try:
            if self._file.write(line.encode()) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), self._file.name)
        except OSError as error:
            self._file.truncate(whole)
            error.filename = error.filename or self._file.name
            raise

    def sync(self) -> None:
        """Makes sure that all rows are on the disk."""
        sync(self._file.fileno())

    def close(self) -> None:
        self._file.close()


def save_divergences(folder: Path, iteration: int, divergences: Iterable[Divergence]) -> Path:
    """Writes the states that led robots to diverge to ``diverged/ITERATION.npz``.

    The file holds ``robot``, ``qpos``, ``qvel`` and ``action``, a row for each robot, to be put back
    with :meth:`~locomotion.envs.LocomotionEnv.set_state`.
    """
    path = folder / "diverged" / f"{iteration:06d}.npz"
    path.parent.mkdir(exist_ok=True)
    with atomic_write(path) as partial:
        np.savez(
            partial,
            robot=[divergence.robot for divergence in divergences],
            qpos=np.stack([divergence.qpos for divergence in divergences]),
            qvel=np.stack([divergence.qvel for divergence in divergences]),
            action=np.stack([divergence.action for divergence in divergences]),
        )
    return path
