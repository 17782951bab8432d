"""The motion of one robot at the rate of the pictures, from which films and pages are made."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import mujoco
import numpy as np
import torch

from locomotion.evaluation import PolicyRunner, measure, speed, walk
from locomotion.physics import Physics


@dataclasses.dataclass(frozen=True)
class Motion:
    """The movement of one robot.

    Attributes:
        model: the compiled model.
        fps: pictures a second.
        qpos: generalised positions at each picture, shape ``(pictures, nq)``; the first one is the
            start, and the last one a picture before the end.
        control_step: number of the control step at each picture.
        seconds: how long the robot walked.
        distance: from its start to its end (m), nan if the simulation diverged.
        speed: distance over that time (m/s), as ``evaluate`` measures it.
    """

    model: mujoco.MjModel
    fps: float
    qpos: np.ndarray
    control_step: np.ndarray
    seconds: float
    distance: float
    speed: float

    @property
    def place(self) -> np.ndarray:
        """The place of the core on the ground at each picture (m), shape ``(pictures, 2)``."""
        return self.qpos[:, :2]

    def speed_at(self, picture: int) -> float:
        """The speed of the walk as far as a picture (m/s)."""
        place = torch.from_numpy(self.place[: picture + 1, None])
        return speed(place, max(picture, 1) / self.fps).item()

    def follow(self, picture: int) -> np.ndarray:
        """The point on the ground (m) at which a camera looks that follows the core without shaking."""
        around = round(self.fps)
        return self.place[max(0, picture - around) : picture + around + 1].mean(0)


def record_motion(
    runner: PolicyRunner,
    seconds: float = 8.0,
    fps: float = 25,
    sampled: bool = False,
    progress: Callable[[], object] = lambda: None,
) -> Motion:
    """Lets the first robot of a runner walk, and keeps how it moved.

    Args:
        runner: robots and their policy.
        seconds: for how long, rounded to control steps.
        fps: pictures a second; there is one at most for each physics step.
        sampled: whether actions are drawn, as in training, or are the policy's mean.
        progress: called after each control step.
    """
    env = runner.base_env
    moments: list[np.ndarray] = []

    def note(physics: Physics) -> None:
        if not moments:
            moments.append(physics.previous[0, 1 : 1 + env.model.nq].numpy(force=True).copy())
        moments.append(physics.qpos[0].numpy(force=True).copy())

    with env.after_substep(note):
        walked = walk(runner, seconds, sampled, progress=progress)
    measured = {name: values[0].item() for name, values in measure(walked).items()}
    rate = 1 / env.model.opt.timestep
    fps = min(fps, rate)
    pictures = max(1, math.floor(fps * (len(moments) - 1) / rate + 1e-9))
    chosen = np.floor(np.arange(pictures) * rate / fps + 1e-9).astype(int)
    return Motion(
        model=env.model,
        fps=fps,
        qpos=np.stack(moments)[chosen],
        control_step=np.floor(chosen / rate / runner.period + 1e-9).astype(int),
        seconds=runner.period * (len(walked.position) - 1),
        distance=measured["distance"],
        speed=measured["speed"],
    )
