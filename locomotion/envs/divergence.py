"""Control steps in which a simulation diverged."""

from __future__ import annotations

import collections
import dataclasses

import torch

from locomotion.physics import Physics

#: How many divergences are kept.
MAX_DIVERGENCES = 1000


@dataclasses.dataclass(frozen=True)
class Divergence:
    """A control step in which a simulation diverged.

    Attributes:
        robot: which one.
        qpos: generalised positions before the step, shape ``(nq,)``; not finite if they were so before.
        qvel: generalised velocities before the step, shape ``(nv,)``.
        action: hinge targets (rad) of the step, shape ``(hinges,)``.
    """

    robot: int
    qpos: torch.Tensor
    qvel: torch.Tensor
    action: torch.Tensor


class DivergenceLog:
    """The last :data:`MAX_DIVERGENCES` divergences that nobody has taken yet."""

    def __init__(self) -> None:
        self._kept = collections.deque[Divergence](maxlen=MAX_DIVERGENCES)

    def note(self, diverged: torch.Tensor | None, physics: Physics, action: torch.Tensor) -> None:
        """Keeps the states and actions that led robots to diverge.

        Args:
            diverged: which ones, as :meth:`~locomotion.physics.Physics.step` returned it.
            physics: the physics, which knows the states before.
            action: hinge targets of all robots, shape ``(num_envs, hinges)``.
        """
        if diverged is None:
            return
        # Not those that robots are put back to: a state that nothing can start from was the culprit.
        motion, nq = physics.previous[:, 1:], physics.model.nq
        for robot in diverged.nonzero().squeeze(-1).tolist():
            state = (motion[robot, :nq], motion[robot, nq:], action[robot])
            copies = (entry.to("cpu", copy=True) for entry in state)
            self._kept.append(Divergence(robot, *copies))

    def take(self) -> list[Divergence]:
        """The divergences since this was last asked."""
        taken = list(self._kept)
        self._kept.clear()
        return taken
