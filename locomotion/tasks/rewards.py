"""Rewards: what a robot is paid for in a control step. A task adds up those that it is given.

A reward is a dataclass of its options, called with the states before and after the control step. One of
your own is one more class here, or in a package of yours (see :mod:`locomotion.options.registry`), and one line
of YAML: ``task.rewards: {mine: {weight: 0.5}}``.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from locomotion.options.checked import Checked, key
from locomotion.options.registry import rewards
from locomotion.options.typed import typed

if TYPE_CHECKING:
    import torch

    from locomotion.tasks.state import RobotState


@dataclasses.dataclass
class Reward(Checked):
    """Base class of rewards.

    A subclass that reads ``after.work`` sets :attr:`NEEDS_WORK`: to add work up, every physics step is
    looked at, which takes time.
    """

    NEEDS_WORK = False
    #: Whether a robot's mirror image is paid the same, which ``ppo.symmetry`` asks for.
    MIRRORED = False

    weight: float = key("factor on this reward", default=1.0)

    def __call__(self, before: RobotState, after: RobotState) -> torch.Tensor:
        """Pays for a control step.

        Args:
            before: the robots before it.
            after: the robots after it.

        Returns:
            Rewards without the weight, shape ``(robots,)``.
        """
        raise NotImplementedError


@rewards.register("distance")
@dataclasses.dataclass
class Distance(Reward):
    """Distance from the start gained (m): the report's reward."""

    MIRRORED = True

    def __call__(self, before: RobotState, after: RobotState) -> torch.Tensor:
        return (after.xy - after.start).norm(dim=-1) - (before.xy - before.start).norm(dim=-1)


@rewards.register("velocity")
@dataclasses.dataclass
class Velocity(Reward):
    """Mean speed of the core along a direction on the ground (m/s)."""

    direction: float = key("angle from the world's x axis (rad)", default=0.0)

    def __call__(self, before: RobotState, after: RobotState) -> torch.Tensor:
        x, y = ((after.xy - before.xy) / after.task.control_timestep).unbind(-1)
        return x * math.cos(self.direction) + y * math.sin(self.direction)


@rewards.register("heading")
@dataclasses.dataclass
class Heading(Reward):
    """Angle by which the core has turned towards a heading (rad)."""

    heading: float = key("angle from the world's x axis (rad)", default=0.0)

    def __call__(self, before: RobotState, after: RobotState) -> torch.Tensor:
        return self._error(before) - self._error(after)

    def _error(self, state: RobotState) -> torch.Tensor:
        off = state.heading - self.heading
        return off.sin().atan2(off.cos()).abs()


@rewards.register("work")
@dataclasses.dataclass
class Work(Reward):
    """Work done by the hinges (J), either way; with a negative weight a price for effort."""

    NEEDS_WORK = True
    MIRRORED = True

    weight: float = key("factor on this reward", default=-0.01)

    def __call__(self, before: RobotState, after: RobotState) -> torch.Tensor:
        return after.work


def make_rewards(options: Mapping[str, Any]) -> list[Reward]:
    """The rewards that ``task.rewards`` names.

    Raises:
        ConfigError: for an unknown name or option, or a value out of range.
    """
    return [
        typed(rewards.get(name, "task.rewards"), values or {}, prefix=f"task.rewards.{name}.")
        for name, values in options.items()
    ]
