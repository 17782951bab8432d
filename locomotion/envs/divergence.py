"""Control steps in which a simulation diverged."""

from __future__ import annotations

import collections
import dataclasses

import torch

from locomotion.physics import Physics

#: How many divergences are kept.
MOST_DIVERGENCES = 1000


@dataclasses.dataclass(frozen=True)
class Divergence:
    """A control step in which a simulation diverged.

    Attributes:
        robot: which one.
        qpos: generalised positions before the step, shape ``(nq,)``.
        qvel: generalised velocities before the step, shape ``(nv,)``.
        action: hinge targets (rad) of the step, shape ``(hinges,)``.
    """

    robot: int
    qpos: torch.Tensor
    qvel: torch.Tensor
    action: torch.Tensor


class DivergenceLog:
    """The last :data:`MOST_DIVERGENCES` divergences that nobody has taken yet."""

    def __init__(self) -> None:
        self._kept = collections.deque[Divergence](maxlen=MOST_DIVERGENCES)

    def note(self, diverged: torch.Tensor | None, physics: Physics, action: torch.Tensor) -> None:
        """Keeps the states and actions that led robots to diverge.

        Args:
            diverged: which ones, as :meth:`~locomotion.physics.Physics.step` returned it.
            physics: the physics, in which they are back in the state before.
            action: hinge targets of all robots, shape ``(num_envs, hinges)``.
        """
        if diverged is None:
            return
        for robot in diverged.nonzero().squeeze(-1).tolist():
            state = (physics.qpos, physics.qvel, action)
            copies = (entry[robot].to("cpu", copy=True) for entry in state)
            self._kept.append(Divergence(robot, *copies))

    def take(self) -> list[Divergence]:
        """The divergences since this was last asked."""
        taken = list(self._kept)
        self._kept.clear()
        return taken
