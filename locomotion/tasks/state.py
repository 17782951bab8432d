"""The state of robots, as rewards and readings see it: on any physics, and in dm-control."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco
    import torch

    from locomotion.tasks.walk_away import WalkAway


@dataclasses.dataclass(frozen=True)
class RobotState:
    """Robots at one moment, a row each.

    Attributes:
        task: the task that they are in.
        model: the compiled model.
        field: reads a field of MuJoCo's ``MjData`` by its name, such as ``"qpos"``; a tensor of shape
            ``(robots, ...)``. Positions come first with the core's place (m) and its orientation, then
            hinges. Fields that MuJoCo derives, such as ``"actuator_force"``, are those of the last
            physics step.
        start: where the cores were on the ground when their episodes began (m), float64 of shape
            ``(robots, 2)``.
        work: by all hinges of a robot in the last control step (J), the integral of torque times speed
            without regard to sign, shape ``(robots,)``; ``None`` unless something asked for it.
        start_heading: headings at which their episodes began (rad), float64 of shape ``(robots,)``, for
            robots without a compass; ``None`` for robots with one.
        drawn: how much of each disturbance is at work, in the order of
            :data:`~locomotion.disturbances.options.DEFAULTS`, from -1 to 1, shape ``(robots,
            disturbances)``; ``None`` where nothing disturbs.
    """

    task: WalkAway
    model: mujoco.MjModel
    field: Callable[[str], torch.Tensor]
    start: torch.Tensor
    work: torch.Tensor | None = None
    start_heading: torch.Tensor | None = None
    drawn: torch.Tensor | None = None

    @property
    def xy(self) -> torch.Tensor:
        """Places of the cores on the ground (m), shape ``(robots, 2)``."""
        return self.field("qpos")[:, :2]

    @property
    def orientation(self) -> torch.Tensor:
        """Orientations of the cores, unit quaternions w x y z, shape ``(robots, 4)``."""
        return self.field("qpos")[:, 3:7]

    @property
    def heading(self) -> torch.Tensor:
        """Angles from the world's x axis to the cores' on the ground (rad), shape ``(robots,)``."""
        w, x, y, z = self.orientation.unbind(-1)
        return (2 * (x * y + w * z)).atan2(1 - 2 * (y * y + z * z))

    @property
    def sensed_orientation(self) -> torch.Tensor:
        """Orientations as an IMU tells them: with a compass those in the world, without one those in a
        world that is turned by the heading at the start.
        """
        if self.start_heading is None:
            return self.orientation
        cos, sin = (self.start_heading / 2).cos(), (self.start_heading / 2).sin()
        orientation = self.orientation
        w, x, y, z = orientation.unbind(-1)
        turned = orientation.new_empty(orientation.shape)
        turned[:, 0], turned[:, 1] = cos * w + sin * z, cos * x + sin * y
        turned[:, 2], turned[:, 3] = cos * y - sin * x, cos * z - sin * w
        return turned

    @property
    def seconds(self) -> torch.Tensor:
        """Time since the episodes began (s), shape ``(robots,)``."""
        return self.field("time") - self.task.settle_steps * self.task.physics_timestep

    def in_core_frame(self, vectors: torch.Tensor) -> torch.Tensor:
        """Turns vectors of the world's frame, shape ``(robots, 3)``, into the cores' frames."""
        return into_frame(self.orientation, vectors)


def into_frame(orientation: torch.Tensor, vectors: torch.Tensor) -> torch.Tensor:
    """Turns vectors of the world's frame, shape ``(robots, 3)``, into frames of their own.

    Args:
        orientation: of the frames, unit quaternions w x y z, frame to world, shape ``(robots, 4)``.
        vectors: the vectors.
    """
    w, u = orientation[:, :1], -orientation[:, 1:]
    # Rotation by the inverse quaternion (w, u): v + 2 w (u x v) + 2 u x (u x v).
    across = 2 * u.cross(vectors, dim=-1)
    return vectors + w * across + u.cross(across, dim=-1)
