"""The seam between the task and whatever steps the physics."""

from __future__ import annotations

import abc

import mujoco
import torch

#: Where a simulation has gone wrong, as no robot gets there by itself: the core that high (m), moved
#: along the ground that fast (m/s) on average, or any other position or velocity that large (SI units).
CEILING = 10.0
MOST_SPEED = 20.0
MOST_STATE = 1000.0


class Physics(abc.ABC):
    """Many copies of one model, each with its own state.

    Positions and velocities alone decide what comes next. The model's first joint is a free one, that
    of the robot's core.

    Attributes:
        model: the compiled model that all copies share.
        num_envs: how many copies there are.
    """

    model: mujoco.MjModel
    num_envs: int

    @property
    @abc.abstractmethod
    def qpos(self) -> torch.Tensor:
        """Generalised positions, float64 of shape ``(num_envs, nq)``.

        A view: it changes with the next :meth:`step` or :meth:`reset`.
        """

    @property
    @abc.abstractmethod
    def qvel(self) -> torch.Tensor:
        """Generalised velocities, float64 of shape ``(num_envs, nv)``; a view like :attr:`qpos`."""

    @abc.abstractmethod
    def reset(self, where: torch.Tensor | None = None) -> None:
        """Puts copies back to the model's initial state, at rest.

        Args:
            where: which copies, bool of shape ``(num_envs,)``; ``None`` means all.
        """

    @abc.abstractmethod
    def step(
        self, control: torch.Tensor, num_steps: int, where: torch.Tensor | None = None
    ) -> torch.Tensor | None:
        """Steps copies under a control that is held.

        A copy diverges if MuJoCo gives its state up, or if what comes out is not finite or beyond
        :data:`CEILING`, :data:`MOST_SPEED` or :data:`MOST_STATE`. It is then left in the state that led there or, where that
        was not one to step from, in the model's initial state.

        Args:
            control: for every copy, shape ``(num_envs, nu)``.
            num_steps: physics steps to take.
            where: which copies, bool of shape ``(num_envs,)``; the others stay as they are.
                ``None`` means all.

        Returns:
            Which copies diverged, bool of shape ``(num_envs,)``; ``None`` if none did.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Ends threads and frees what the copies hold."""
