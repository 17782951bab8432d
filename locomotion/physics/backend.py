"""The interface of a backend; :mod:`locomotion.physics.base` does the rest."""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any

import torch


class Backend(abc.ABC):
    """Holds the states of many copies of one model and advances them.

    Fields are named as in MuJoCo's ``MjData`` and ``MjModel``.

    Attributes:
        MAX_STEPS: physics steps that are taken, and checked, at a time.
    """

    MAX_STEPS: int
    #: The fields of ``MjData`` that were asked for; views.
    _fields: dict[str, torch.Tensor]

    @property
    @abc.abstractmethod
    def motion(self) -> torch.Tensor:
        """Times (s), positions and velocities, float64 of shape ``(num_envs, 1 + nq + nv)``.

        A view: it changes with the next :meth:`step` or :meth:`reset`, and what is written to it is
        where the next step begins. Places on the ground are the true ones, however far away.
        """

    @property
    @abc.abstractmethod
    def control(self) -> torch.Tensor:
        """Hinge targets (rad) that were last given, shape ``(num_envs, nu)``; a view."""

    @abc.abstractmethod
    def field(self, name: str) -> torch.Tensor:
        """A field of ``MjData``, a row a copy; a view that each step renews.

        Derived fields are those of the last physics step; one that is asked for the first time is
        computed of the states as they are, and from then on in every step.
        """

    @abc.abstractmethod
    def set_const(self) -> None:
        """Computes anew the constants that depend on parameters which were written."""

    @abc.abstractmethod
    def forward(self, where: torch.Tensor | None = None) -> None:
        """Computes the derived fields that were asked for, of states that were written.

        Args:
            where: of which copies, bool of shape ``(num_envs,)``; ``None`` means all.
        """

    @abc.abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """The integration state of all copies and their own parameters; tensors of their own."""

    @abc.abstractmethod
    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Puts all copies into a state from :meth:`state_dict`."""

    @abc.abstractmethod
    def close(self) -> None:
        """Ends threads and frees what stepping takes; positions and velocities can still be read.

        All else that is asked of it then is a ``RuntimeError``.
        """

    @abc.abstractmethod
    def _arguments(self) -> tuple[Any, ...]:
        """The arguments that make another one like this."""

    @property
    @abc.abstractmethod
    def _history(self) -> torch.Tensor | None:
        """Targets that are under way, a row a copy; ``None`` for a model without latency."""

    @abc.abstractmethod
    def _expand(self, name: str) -> torch.Tensor:
        """Gives a field of ``MjModel`` a value for each copy."""

    @abc.abstractmethod
    def _reset(self, where: torch.Tensor | None) -> None:
        """Puts copies back to the model's initial state."""

    @abc.abstractmethod
    def _advance(self, num_steps: int, where: torch.Tensor | None) -> None:
        """Takes at most :attr:`MAX_STEPS` physics steps.

        A copy whose state is given up shows it by a time that is behind.
        """

    def _cleanse(self, wrong: torch.Tensor) -> None:
        """Removes what copies that went wrong would leave for the next step, apart from their state."""
