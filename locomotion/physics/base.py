"""The seam between the task and whatever steps the physics."""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import torch

from locomotion.options import ConfigError
from locomotion.tasks.options import delay_for

#: Bounds of a sound simulation, as no robot gets there by itself: the core's height (m), its mean speed
#: along the ground (m/s), and any other position or velocity (SI units).
CEILING = 10.0
MOST_SPEED = 20.0
MOST_STATE = 1000.0


class Physics(abc.ABC):
    """Many copies of one model, each with its own state and, where asked for, its own parameters.

    The model's first joint is a free one, that of the robot's core; all others are hinges. Fields are
    named as in MuJoCo's ``MjData`` and ``MjModel``. A backend holds the states and advances them; what
    is sound, what is put back and how a long control step is divided stands here.

    Args:
        model: the compiled model that all copies share.
        num_envs: number of copies.
        device: where states are, and everything computed from them.

    Attributes:
        model: as given.
        num_envs: as given.
        device: as given.
        previous: times, positions and velocities before the last :meth:`step`, or while it is watched
            before the last physics step, float64 of shape ``(num_envs, 1 + nq + nv)``.
    """

    #: Physics steps that are taken, and checked, at a time.
    MOST_STEPS: int

    def __init__(self, model: mujoco.MjModel, num_envs: int, device: torch.device) -> None:
        _require_walker(model)
        self.model = model
        self.num_envs = num_envs
        self.device = device
        columns = 1 + model.nq + model.nv
        # A state is compared with where it should be: time and place are known, the rest is around 0.
        self._known = torch.zeros(columns, dtype=torch.float64, device=device)
        self._known[:3] = 1.0
        self._steps_bounds: dict[int, tuple[torch.Tensor, torch.Tensor]] = {}
        self._parameters: dict[str, torch.Tensor] = {}
        self.previous = torch.zeros(num_envs, columns, dtype=torch.float64, device=device)

    # What a backend provides.

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
        """Ends threads and frees what stepping takes; positions and velocities can still be read."""

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
        """Takes at most :attr:`MOST_STEPS` physics steps.

        A copy whose state is given up shows it by a time that is behind.
        """

    def _cleanse(self, wrong: torch.Tensor) -> None:
        """Removes what copies that went wrong would leave for the next step, apart from their state."""

    # What is the same for all of them.

    @property
    def qpos(self) -> torch.Tensor:
        """Generalised positions, float64 of shape ``(num_envs, nq)``; a view of :attr:`motion`."""
        return self.motion[:, 1 : 1 + self.model.nq]

    @property
    def qvel(self) -> torch.Tensor:
        """Generalised velocities, float64 of shape ``(num_envs, nv)``; a view of :attr:`motion`."""
        return self.motion[:, 1 + self.model.nq :]

    def expand(self, name: str) -> torch.Tensor:
        """Gives a field of ``MjModel`` a value for each copy, and returns these to be written.

        :meth:`set_const` must follow where other constants depend on the field, as for masses.
        """
        if name not in self._parameters:
            self._parameters[name] = self._expand(name)
        return self._parameters[name]

    def _load_parameters(self, values: Mapping[str, torch.Tensor]) -> None:
        for name in values:
            self.expand(name)
        for name, own in self._parameters.items():
            value = values[name] if name in values else torch.as_tensor(getattr(self.model, name))
            own.copy_(value.reshape(-1, *own.shape[1:]))

    def reset(self, where: torch.Tensor | None = None) -> None:
        """Puts copies back to the model's initial state, at rest and at time 0.

        Args:
            where: which copies, bool of shape ``(num_envs,)``; ``None`` means all.
        """
        self._reset(where)

    def step(
        self,
        control: torch.Tensor,
        num_steps: int,
        where: torch.Tensor | None = None,
        watch: Callable[[Physics], object] | None = None,
    ) -> torch.Tensor | None:
        """Steps copies under a control that is held.

        A copy diverges if its control is not finite, if MuJoCo gives its state up, or if the state that
        it comes to is not finite or beyond :data:`CEILING`, :data:`MOST_SPEED` or :data:`MOST_STATE`.
        It is then left in the state that led there or, where that was not one to step from, in the
        model's initial state.

        Args:
            control: hinge targets (rad) of every copy, shape ``(num_envs, nu)``.
            num_steps: physics steps to take.
            where: which copies, bool of shape ``(num_envs,)``; the others stay as they are.
                ``None`` means all.
            watch: called with this object after each physics step; copies that diverged are already
                back. The steps come out as they would without, but are taken one at a time.

        Returns:
            Which copies diverged, bool of shape ``(num_envs,)``; ``None`` if none did.

        Raises:
            ConfigError: if the configuration left too little room for the contacts that there were.
        """
        if num_steps == 0 or (where is not None and not where.any()):
            return None
        start, given = self.motion.clone(), self.control
        history = None if self._history is None else self._history.clone()
        given.copy_(control if where is None else torch.where(where[:, None], control, given))
        wrong = given.isfinite().all(1).logical_not_()
        at_once = self.MOST_STEPS if watch is None else 1
        moving, before, any_wrong = where, start, False
        for done in range(0, num_steps, at_once):
            steps = min(at_once, num_steps - done)
            self._advance(steps, moving)
            wrong |= self._beyond(before, self.motion, steps)
            last = done + steps == num_steps
            if last or watch is not None:
                if where is not None:
                    wrong &= where
                any_wrong = self._any(wrong)
                if any_wrong:
                    self._put_back(start, history, wrong)
                    moving = ~wrong if where is None else where & ~wrong
            if watch is not None:
                self.previous = before
                watch(self)
            if not last:
                before = self.motion.clone()
        self.previous = start
        return wrong if any_wrong else None

    def _any(self, wrong: torch.Tensor) -> bool:
        """Whether a copy went wrong; the only place where the host waits for a device."""
        return bool(wrong.any())

    def _beyond(self, start: torch.Tensor, end: torch.Tensor, steps: int) -> torch.Tensor:
        if steps not in self._steps_bounds:
            timestep = self.model.opt.timestep
            bound = torch.full_like(self._known, MOST_STATE)
            bound[0] = timestep / 2
            bound[1:3] = MOST_SPEED * steps * timestep
            bound[3] = CEILING
            ahead = torch.zeros_like(self._known)
            ahead[0] = steps * timestep
            self._steps_bounds[steps] = ahead, bound
        ahead, bound = self._steps_bounds[steps]
        off = torch.addcmul(ahead, start, self._known).sub_(end).abs_()
        return (off <= bound).all(1).logical_not_()  # in this form, so that nan is beyond

    def _put_back(
        self, start: torch.Tensor, history: torch.Tensor | None, wrong: torch.Tensor
    ) -> None:
        lost = ~start[:, :3].isfinite().all(1) | self._beyond(start, start, 0)
        self.motion[wrong] = start[wrong]
        self.control[wrong] = self.control[wrong].nan_to_num(0.0, 0.0, 0.0)
        if history is not None:
            self._history[wrong] = history[wrong]
        self._reset(wrong & lost)
        self._cleanse(wrong)
        self.forward(wrong)

    def set_latency(self, latency: torch.Tensor | float) -> None:
        """Sets how late each copy's hinges get their targets.

        Args:
            latency: in seconds, shape ``(num_envs,)`` or one for all. Targets that are under way
                arrive by the new latency.

        Raises:
            ConfigError: if a latency is longer than the one that the model was compiled with.
        """
        latency = torch.as_tensor(latency, dtype=torch.float64)
        least, most = latency.min().item(), latency.max().item()
        timestep = self.model.opt.timestep
        room = max(0, self.model.actuator_history[:, 0].min() - 1) * timestep
        if not least >= 0:
            raise ConfigError(f"a latency of {least:g} s is not possible; it must be at least 0")
        if not most <= room + 1e-3 * timestep:
            raise ConfigError(
                f"a latency of {most:g} s is beyond the {room:g} s that the model has room for;"
                " physics.latency makes room"
            )
        delay = self.expand("actuator_delay")
        delay.copy_(delay_for(latency, timestep).reshape(-1, 1))


def _require_walker(model: mujoco.MjModel) -> None:
    hinges = model.jnt_type[1:] == mujoco.mjtJoint.mjJNT_HINGE
    if not model.njnt or model.jnt_type[0] != mujoco.mjtJoint.mjJNT_FREE or not hinges.all():
        raise ValueError("the model's joints must be a free one, then hinges")
