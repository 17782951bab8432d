"""Checkpoints, from which a run is resumed and its policy is read."""

from __future__ import annotations

import re
import shutil
import sys
import zipfile
from pathlib import Path
from typing import Any

from torchrl.checkpoint import Checkpoint, CheckpointError, StateDictCheckpointAdapter

from locomotion.runs import RunError, RunStopped
from locomotion.writing import atomic_write

#: Where checkpoints are in a run's folder; each is named by how many iterations are behind it.
FOLDER = "checkpoints"


class Checkpoints:
    """The checkpoints of a run: TorchRL's, as one archive each, that appear whole or not at all.

    Args:
        run: the run's folder.
        components: by name, what has a ``state_dict``. To read a checkpoint, give those that are
            wanted; the others are left alone.
    """

    def __init__(self, run: Path, **components: Any) -> None:
        self.folder = run / FOLDER
        self._checkpoint = Checkpoint(format="archive")
        for name, component in components.items():
            # Weights and plain values: what is loaded with weights_only=True runs no code.
            self._checkpoint.register(name, component, adapter=StateDictCheckpointAdapter("torch"))

    def save(self, iteration: int) -> Path:
        """Writes a checkpoint.

        Args:
            iteration: how many iterations are behind it.

        Raises:
            RunStopped: if it could not be written; the other checkpoints are as they were.
        """
        path = path_of(self.folder.parent, iteration)
        self.folder.mkdir(exist_ok=True)
        try:
            with atomic_write(path) as partial:
                self._checkpoint.save(partial)
        except (OSError, RuntimeError) as error:
            reason = getattr(error, "strerror", None) or _first_line(error)
            if shutil.disk_usage(self.folder).free < 2**20:  # torch does not say so
                reason = "no space left on the disk"
            raise RunStopped(f"{path} could not be written: {reason}") from error
        finally:
            self.remove_partial()
        return path

    def load_latest(self) -> int:
        """Loads the last checkpoint; one that is damaged is named, and the one before it is taken.

        Returns:
            The number of iterations behind it; 0 without a checkpoint.

        Raises:
            RunError: if all checkpoints are damaged, or the last one is from another kind of run.
        """
        paths = saved(self.folder.parent)
        for path in reversed(paths):
            damage = _damage(path)
            if damage is not None:
                print(f"warning: {path} {damage}; looking at the one before it", file=sys.stderr)
                continue
            try:
                # What a GPU wrote can be read without one.
                self._checkpoint.load(path.absolute(), map_location="cpu")
            except (CheckpointError, KeyError, TypeError, ValueError) as error:
                raise RunError(f"{path} does not fit this run: {_first_line(error)}") from error
            return int(path.stem)
        if paths:
            raise RunError(f"{self.folder} holds no checkpoint that is whole")
        return 0

    def remove_partial(self) -> None:
        """Removes what was being written when a run was killed."""
        for path in self.folder.glob(".*"):
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def saved(run: Path) -> list[Path]:
    """The checkpoints in a run's folder, whole or not, in the order of iterations."""
    paths = (run / FOLDER).glob("*.ckpt")
    return sorted(
        (path for path in paths if path.stem.isdecimal()), key=lambda path: int(path.stem)
    )


def path_of(run: Path, iteration: int) -> Path:
    """The path of the checkpoint that follows an iteration, by the number of iterations done."""
    return run / FOLDER / f"{iteration:06d}.ckpt"


def _damage(path: Path) -> str | None:
    """The damage of a checkpoint, in words; ``None`` if all is well."""
    try:
        with zipfile.ZipFile(path) as archive:
            if archive.testzip() is not None:
                return "is damaged"
            names = archive.namelist()
        Checkpoint.manifest(path.absolute())  # TorchRL takes a name with ~ for a home
    except Exception:  # noqa: BLE001  whatever a reader stumbles over
        return "is cut short or damaged"
    # Other payloads than weights might be pickles.
    if any(name != "manifest.json" and not re.search(r"/state\.pt$", name) for name in names):
        return "holds more than weights"
    return None


def _first_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
