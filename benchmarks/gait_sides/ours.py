"""Ours: training as ``python -m locomotion.train`` does it, with all that it records and saves."""

from __future__ import annotations

from pathlib import Path

from benchmarks.gait_sides import EXPERIMENTS, Task
from benchmarks.gait_sides.record import Recorder
from locomotion import compose, train


def learn(task: Task, recorder: Recorder) -> None:
    chosen = EXPERIMENTS[task.setting]
    config = compose(f"robot={task.robot}", "+obs=history3", f"seed={task.seed}", *chosen)
    train(
        config,
        Path(task.folder, "run"),
        callbacks=[lambda row: recorder.write(row["frames"], row["mean_reward"])],
    )
