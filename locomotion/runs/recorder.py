"""The traces of a run as it is trained: rows, curves elsewhere, checkpoints, progress."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Mapping
from multiprocessing import parent_process
from pathlib import Path
from typing import Any, Self

from tensordict import TensorDictBase
from torchrl.checkpoint import GlobalRNGState
from tqdm import tqdm

from locomotion.agents.base import Learner
from locomotion.config import Config
from locomotion.options.paths import quoted
from locomotion.runs.checkpoints import Checkpoints, saved
from locomotion.runs.folder import RunStopped
from locomotion.runs.loggers import open_logger
from locomotion.runs.metrics import MetricsWriter, save_divergences
from locomotion.writing import remove_partial


class Recorder:
    """Records a run in its folder, and resumes the one that is there.

    Args:
        config: the run.
        folder: its folder, which exists.
        env: the environment, with a ``state_dict``.
        learner: the learner.

    Attributes:
        completed: iterations that are behind the run.

    Raises:
        RunError: if what is in the folder cannot be resumed.
    """

    def __init__(self, config: Config, folder: Path, env: Any, learner: Learner) -> None:
        self._config = config
        self._folder = folder
        self._frames = env.batch_size.numel() * config.learner.steps
        self._take_divergences = getattr(env.base_env, "take_divergences", list)
        self._checkpoints = Checkpoints(
            folder,
            policy=learner.policy,
            learner=learner,
            env=env,
            random=GlobalRNGState(),
        )
        self._checkpoints.remove_partial()
        for place in (folder, folder / ".hydra"):
            remove_partial(place)
        self.completed = self._checkpoints.load_latest()
        self._take_divergences()  # of robots that the checkpoint replaced
        self._metrics = MetricsWriter(folder, self.completed)
        self._logger = open_logger(folder, config, self.completed * self._frames)
        # No bar without a terminal, nor next to other jobs, whose bars would write over one another.
        self._bar = tqdm(
            total=config.learner.iterations,
            initial=self.completed,
            desc=config.robot.name,
            unit="iteration",
            disable=True if parent_process() is not None else None,
        )
        self._began = time.perf_counter()

    @property
    def finished(self) -> bool:
        """Whether all iterations are behind the run."""
        return self.completed >= self._config.learner.iterations

    def record(
        self, batch: TensorDictBase, metrics: Mapping[str, float], collected: float
    ) -> dict[str, float]:
        """Writes the row of an iteration.

        Args:
            batch: the experience of it.
            metrics: of the learner.
            collected: when it had been collected, by :func:`time.perf_counter`.

        Returns:
            The row.
        """
        finished = time.perf_counter()
        divergences = self._take_divergences()
        if divergences:
            path = save_divergences(self._folder, self.completed, divergences)
            self._bar.write(f"simulations diverged: {path}", file=sys.stderr)
        others = {name: value for name, value in metrics.items() if name != "mean_value"}
        row = {
            "iteration": self.completed,
            "frames": (self.completed + 1) * self._frames,
            "mean_reward": batch["next", "reward"].mean().item(),
            "mean_value": metrics.get("mean_value", float("nan")),
            **others,
            "diverged": batch["next", "terminated"].sum().item(),
            "collect_seconds": collected - self._began,
            "update_seconds": finished - collected,
        }
        self._metrics.write(row)
        if self._logger is not None:
            self._logger.log(row)
        fps = self._frames / (finished - self._began)
        reward = f"{row['mean_reward']:.4f}"
        self._bar.set_postfix(reward=reward, fps=f"{fps:.0f}", refresh=False)
        self._bar.update()
        self.completed += 1
        return row

    def save_if_due(self, stopping: bool) -> None:
        """Saves a checkpoint at regular intervals, after the last iteration, and when stopping."""
        if self.completed % self._config.checkpoint_interval == 0 or self.finished or stopping:
            self._metrics.sync()
            if self._logger is not None:
                self._logger.flush()
            self._checkpoints.save(self.completed)
        self._began = time.perf_counter()

    def explain(self, error: FloatingPointError) -> RunStopped:
        """The end of a run whose learner is no longer a finite number."""
        last = (saved(self._folder) or ["none"])[-1]
        return RunStopped(
            f"{error} in iteration {self.completed}; the last good checkpoint is {last}"
        )

    def __enter__(self) -> Self:
        self._began = time.perf_counter()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._bar.close()
        self._metrics.close()
        if self._logger is not None:
            if kind is None and self._config.logger.video_seconds:
                self._film()
            self._logger.close()

    def _film(self) -> None:
        """Films the trained policy for a logger; where nothing can be drawn it says so.

        In a process of its own, as a graphics driver may crash and would take the run with it.
        """
        film = self._folder / f"gait{self._logger.film_ending}"
        options = [
            f"seconds={self._config.logger.video_seconds}",
            "width=480",
            "height=270",
            "fps=10",
        ]
        places = (("run", self._folder), ("output", film))
        options += [f"{key}={quoted(path)}" for key, path in places]
        if self._config.plugins:
            options.append(f"+plugins={json.dumps(self._config.plugins, ensure_ascii=False)}")
        command = [sys.executable, "-m", "locomotion.watch", *options]
        watched = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace")
        if watched.returncode == 0:
            self._logger.log_film(film, self.completed * self._frames)
        else:
            reason = (watched.stderr.splitlines() or ["it ended without a word"])[-1]
            line = f"warning: {self._folder}: no film of the gait; {reason}"
            self._bar.write(line, file=sys.stderr)
