"""TensorBoard and Weights & Biases, through TorchRL's loggers: curves, configuration and a film."""

from __future__ import annotations

import abc
import os
import secrets
from collections.abc import Mapping
from pathlib import Path

from omegaconf import OmegaConf

from locomotion.config import Config, LoggerBackend, as_dict
from locomotion.runs import RunError
from locomotion.writing import atomic_write


class RunLogger(abc.ABC):
    """Shows a run elsewhere.

    Attributes:
        film_ending: of the kind of film that :meth:`log_film` takes.
    """

    film_ending: str

    @abc.abstractmethod
    def log(self, row: Mapping[str, float]) -> None:
        """Shows the metrics of an iteration."""

    @abc.abstractmethod
    def log_film(self, film: Path, frames: int) -> None:
        """Shows a film of the policy, at a number of frames."""

    @abc.abstractmethod
    def flush(self) -> None:
        """Writes what has been logged, as a checkpoint will not have it logged again."""

    @abc.abstractmethod
    def close(self) -> None:
        """Sends or writes what is left."""


def open_logger(folder: Path, config: Config, frames: int) -> RunLogger | None:
    """The logger that a configuration asks for; ``None`` for ``metrics.csv`` alone.

    Args:
        folder: the run's folder.
        config: the run.
        frames: how many frames are behind the run. TensorBoard replaces what had been logged of later
            ones; Weights & Biases keeps it, as the rows that come again are the same.

    Raises:
        RunError: if the logger cannot be opened, such as without an account.
    """
    if config.logger.backend is LoggerBackend.tensorboard:
        return TensorBoard(folder, config, frames)
    if config.logger.backend is LoggerBackend.wandb:
        return WeightsAndBiases(folder, config)
    return None


class TensorBoard(RunLogger):
    """Event files in ``tensorboard/``."""

    film_ending = ".gif"

    def __init__(self, folder: Path, config: Config, frames: int) -> None:
        from torchrl.record.loggers.tensorboard import TensorboardLogger

        before = any((folder / "tensorboard").glob("events*"))
        self._logger = TensorboardLogger(exp_name="tensorboard", log_dir=str(folder.absolute()))
        if before:  # hides what the run had logged after the checkpoint
            self._logger.experiment.close()
            self._logger.experiment.purge_step = frames + 1
        else:
            text = OmegaConf.to_yaml(as_dict(config))
            indented = "".join(f"    {line}\n" for line in text.splitlines())
            self._logger.experiment.add_text("configuration", indented, 0)

    def log(self, row: Mapping[str, float]) -> None:
        self._logger.log_metrics(dict(row), step=int(row["frames"]))

    def flush(self) -> None:
        self._logger.experiment.flush()

    def log_film(self, film: Path, frames: int) -> None:
        # An animated picture that is encoded already; TorchRL's log_video would need moviepy for that.
        from PIL import Image
        from tensorboard.compat.proto.summary_pb2 import Summary

        with Image.open(film) as picture:
            width, height = picture.size
        shown = Summary.Image(
            width=width, height=height, colorspace=3, encoded_image_string=film.read_bytes()
        )
        summary = Summary(value=[Summary.Value(tag="gait", image=shown)])
        self._logger.experiment.file_writer.add_summary(summary, frames)

    def close(self) -> None:
        self._logger.experiment.close()


class WeightsAndBiases(RunLogger):
    """A run of Weights & Biases, its files in ``wandb/``; one that goes on keeps its identity."""

    film_ending = ".mp4"

    def __init__(self, folder: Path, config: Config) -> None:
        import wandb
        from torchrl.record.loggers.wandb import WandbLogger

        try:
            self._logger = WandbLogger(
                exp_name=f"{config.robot.name}-seed{config.seed}",
                save_dir=str(folder.absolute()),
                id=_identity(folder),
                project=os.environ.get("WANDB_PROJECT", "locomotion"),
                log_env_packages=False,
                settings=wandb.Settings(silent=True, console="off"),
            )
        except (wandb.Error, OSError) as error:
            reason = " ".join(str(error).split())
            raise RunError(
                f"logger=wandb: {reason} WANDB_MODE=offline works without an account"
            ) from error
        self._logger.log_hparams(as_dict(config))

    def log(self, row: Mapping[str, float]) -> None:
        self._logger.experiment.log(dict(row), step=int(row["frames"]))

    def flush(self) -> None:
        """Weights & Biases writes by itself, at the end of the process too."""

    def log_film(self, film: Path, frames: int) -> None:
        import wandb

        self._logger.experiment.log({"gait": wandb.Video(str(film))}, step=frames)

    def close(self) -> None:
        self._logger.experiment.finish()


def _identity(folder: Path) -> str:
    """The run's name at Weights & Biases, kept for when it is resumed."""
    path = folder / "wandb.id"
    if not path.is_file():
        with atomic_write(path) as partial:
            partial.write_text(secrets.token_hex(8), encoding="utf-8")
    return path.read_text(encoding="utf-8")
