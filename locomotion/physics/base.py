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
        device: where positions and velocities are, and everything computed from them.
    """

    model: mujoco.MjModel
    num_envs: int
    device: torch.device

    @property
    @abc.abstractmethod
    def qpos(self) -> torch.Tensor:
        """Generalised positions, float64 of shape ``(num_envs, nq)``.

        A view: it changes with the next :meth:`step` or :meth:`reset`, and what is written to it is
        where the next step begins. The place on the ground is the true one, however far away.
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
        :data:`CEILING`, :data:`MOST_SPEED` or :data:`MOST_STATE`. It is then left in the state that
        led there or, where that was not one to step from, in the model's initial state.

        Args:
            control: for every copy, shape ``(num_envs, nu)``.
            num_steps: physics steps to take.
            where: which copies, bool of shape ``(num_envs,)``; the others stay as they are.
                ``None`` means all.

        Returns:
            Which copies diverged, bool of shape ``(num_envs,)``; ``None`` if none did.

        Raises:
            ConfigError: if the configuration left too little room for the contacts that there were.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Ends threads and frees what stepping takes; the state can still be read."""


def require_plain(model: mujoco.MjModel) -> None:
    """Raises a :class:`ValueError` if positions and velocities are not all that a model's state is."""
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    if size != 1 + model.nq + model.nv or model.nsensordata:
        raise ValueError("the model has sensors, or state beyond time, positions, velocities")
    if model.jnt_type[0] != mujoco.mjtJoint.mjJNT_FREE:
        raise ValueError("the model's first joint is not free")
