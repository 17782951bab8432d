"""What a film and a page are made from: how one robot moved, at the pictures' rate."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import mujoco
import numpy as np

from locomotion.evaluation import Walker, walk
from locomotion.physics import Physics


@dataclasses.dataclass(frozen=True)
class Motion:
    """The movement of one robot.

    Attributes:
        model: the compiled model.
        fps: pictures a second.
        qpos: generalised positions at each picture, shape ``(pictures, nq)``.
        control_step: number of the control step at each picture.
        period: time of a control step (s).
    """

    model: mujoco.MjModel
    fps: float
    qpos: np.ndarray
    control_step: np.ndarray
    period: float

    @property
    def place(self) -> np.ndarray:
        """Where the core is on the ground at each picture (m), shape ``(pictures, 2)``."""
        return self.qpos[:, :2]

    def speed(self, picture: int) -> float:
        """Distance from the start over time (m/s) at a picture."""
        way = self.place[picture] - self.place[0]
        return float(np.linalg.norm(way)) * self.fps / max(picture, 1)

    def follow(self, picture: int) -> np.ndarray:
        """Where a camera looks that follows the core without shaking, on the ground (m)."""
        around = round(self.fps)
        return self.place[max(0, picture - around) : picture + around + 1].mean(0)


def record_motion(
    walker: Walker,
    seconds: float,
    fps: int,
    sampled: bool = False,
    progress: Callable[[], object] = lambda: None,
) -> Motion:
    """Has the first robot of a walker walk, and keeps how it moved.

    Args:
        walker: who walks.
        seconds: for how long.
        fps: pictures a second; there is one at most for each physics step.
        sampled: whether actions are drawn, as in training, or are the policy's mean.
        progress: called after each control step.
    """
    env = walker.env.base_env
    moments: list[np.ndarray] = []

    def note(physics: Physics) -> None:
        moments.append(physics.qpos[0].numpy(force=True).copy())

    with env.after_substep(note):
        walk(walker, seconds, sampled, progress=progress)
    rate = 1 / env.model.opt.timestep
    fps = min(fps, rate)
    moments_of_pictures = np.arange(0, len(moments), rate / fps).astype(int)
    steps = (moments_of_pictures / rate / walker.period).astype(int)
    return Motion(env.model, fps, np.stack(moments)[moments_of_pictures], steps, walker.period)
