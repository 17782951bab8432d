"""The seam between the task and whatever steps the physics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import torch

from locomotion.arenas.periodic import period_of
from locomotion.physics.backend import Backend
from locomotion.physics.bounds import Bounds, Limits
from locomotion.physics.latency import set_delay
from locomotion.tasks.work import hinge_work


class Physics(Backend):
    """Many copies of one model, each with its own state and, where asked for, its own parameters.

    The model's first joint is a free one, that of the robot's core; all others are hinges. Fields are
    named as in MuJoCo's ``MjData`` and ``MjModel``. A backend holds the states and advances them; what
    is sound, what is put back and how a long control step is divided stands here.

    A copy that :func:`copy.deepcopy` or :mod:`pickle` makes has the states and the parameters of the
    original. What :meth:`close` closed is opened again by :meth:`load_state_dict`.

    Args:
        model: the compiled model that all copies share.
        num_envs: number of copies.
        device: where states are, and everything computed from them.
        limits: what is believed of a robot's motion.

    Attributes:
        model: as given.
        num_envs: as given.
        device: as given.
        limits: as given.
        closed: whether it can no longer be stepped.
        previous: times, positions and velocities before the last :meth:`step`, or while it is watched
            before the last physics step, float64 of shape ``(num_envs, 1 + nq + nv)``.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        num_envs: int,
        device: torch.device,
        limits: Limits | None = None,
    ) -> None:
        _require_walker(model)
        self.model = model
        self.num_envs = num_envs
        self.device = device
        self.limits = limits or Limits()
        self.closed = False
        columns = 1 + model.nq + model.nv
        self._bounds = Bounds(self.limits, columns, model.opt.timestep, device)
        self._parameters: dict[str, torch.Tensor] = {}
        self._shared: dict[str, torch.Tensor] = {}
        self._period = period_of(model)
        self._ground = torch.zeros(num_envs, 2, dtype=torch.float64, device=device)
        self.previous = torch.zeros(num_envs, columns, dtype=torch.float64, device=device)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.num_envs} on {self.device}{', closed' * self.closed})"

    def __getstate__(self) -> dict[str, Any]:
        return {
            "arguments": self._arguments(),
            "state": None if self.closed else self.state_dict(),
            "motion": self.motion.clone(),
            "control": self.control.clone(),
            "fields": {name: value.clone() for name, value in self._fields.items()},
            "previous": self.previous.clone(),
        }

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self.__init__(*state["arguments"])
        for name in state["fields"]:
            self.field(name)
        if state["state"] is not None:
            self.load_state_dict(state["state"])
        # Those of the last physics step, which are not those of the state that it led to.
        for name, value in state["fields"].items():
            self.field(name).copy_(value)
        self.previous.copy_(state["previous"])
        if state["state"] is None:
            self.motion.copy_(state["motion"])
            self.control.copy_(state["control"])
            self.close()

    def _require_open(self) -> None:
        if self.closed:
            raise RuntimeError(
                "the environment was closed, as TorchRL's ParallelEnv does with one that a function did"
                " not make anew: make a new one, or open it again by load_state_dict()"
            )

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
        self._require_open()
        if name not in self._parameters:
            self._parameters[name] = self._expand(name)
        return self._parameters[name]

    def parameter(self, name: str) -> torch.Tensor:
        """A field of ``MjModel``, to be read: a row for each copy that has its own, else one for all."""
        if name in self._parameters:
            return self._parameters[name]
        return self._shared_field(name)

    def _shared_field(self, name: str) -> torch.Tensor:
        if name not in self._shared:
            value = torch.as_tensor(getattr(self.model, name), device=self.device)
            self._shared[name] = value[None]
        return self._shared[name]

    def hinge_work(self) -> torch.Tensor:
        """Work of all hinges of each copy in the physics step that is being watched (J).

        Without regard to sign, as :func:`locomotion.tasks.work.hinge_work` has it; shape
        ``(num_envs,)``. Only whoever watches :meth:`step` can ask, and has asked for the field
        ``actuator_force`` before.
        """
        before = self.previous[:, 1 + self.model.nq :]
        force = self.field("actuator_force").to(before.dtype)
        return hinge_work(self.parameter, self.model.opt.timestep, force, before, self.qvel)

    def _load_parameters(self, values: Mapping[str, torch.Tensor]) -> None:
        for name in values:
            self.expand(name)
        for name, own in self._parameters.items():
            value = values[name] if name in values else self._shared_field(name)
            own.copy_(value.reshape(-1, *own.shape[1:]))

    def reset(self, where: torch.Tensor | None = None) -> None:
        """Puts copies back to the model's initial state, at rest and at time 0.

        Args:
            where: which copies, bool of shape ``(num_envs,)``; ``None`` means all.
        """
        self._require_open()
        self._reset(where)

    def put(
        self,
        time: float,
        qpos: torch.Tensor,
        qvel: torch.Tensor,
        where: torch.Tensor | None = None,
    ) -> None:
        """Puts copies into a state, in which no target is under way.

        Args:
            time: of the state (s).
            qpos: generalised positions, shape ``(num_envs, nq)`` or what is broadcast to it.
            qvel: generalised velocities, shape ``(num_envs, nv)`` likewise.
            where: which copies, bool of shape ``(num_envs,)``; ``None`` means all.
        """
        nq, rows = self.model.nq, slice(None) if where is None else where
        self.reset(where)
        motion = self.motion.clone()
        motion[:, 0] = time
        motion[:, 1 : 1 + nq] = qpos
        motion[:, 1 + nq :] = qvel
        self.motion[rows] = motion[rows]
        self.forward(where)

    def step(
        self,
        control: torch.Tensor,
        num_steps: int,
        where: torch.Tensor | None = None,
        watch: Callable[[Physics], object] | None = None,
    ) -> torch.Tensor | None:
        """Steps copies under a control that is held.

        A copy diverges if its control is not finite, if MuJoCo gives its state up, or if the state that
        it comes to is not finite or beyond :attr:`limits` or
        :data:`~locomotion.physics.bounds.MAX_STATE`.
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
            ValueError: for a control of another shape or of other numbers.
        """
        self._require_open()
        self.require_control(control)
        if num_steps == 0 or (where is not None and not where.any()):
            return None
        self._follow()
        start, given = self.motion.clone(), self.control
        history = None if self._history is None else self._history.clone()
        given.copy_(control if where is None else torch.where(where[:, None], control, given))
        wrong = given.isfinite().all(1).logical_not_()
        at_once = self.MAX_STEPS if watch is None else 1
        moving, before, since, counted, any_wrong = where, start, start, 0, False
        for done in range(0, num_steps, at_once):
            steps = min(at_once, num_steps - done)
            self._advance(steps, moving)
            last, counted = done + steps == num_steps, counted + steps
            # Limits count where they would without anybody who watches.
            ends = last or counted == self.MAX_STEPS
            wrong |= self._bounds.beyond(since, self.motion, counted, passing=not ends)
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
                since, counted = (before, 0) if ends else (since, counted)
        self.previous = start
        return wrong if any_wrong else None

    def _follow(self) -> None:
        """Moves periodic ground under the robots, by whole periods."""
        if self._period is not None:
            torch.round(self.motion[:, 1:3] / self._period, out=self._ground)
            self._ground *= self._period

    def require_control(self, control: torch.Tensor) -> None:
        """Raises a :class:`ValueError` for a control of another shape or of other numbers."""
        shape = (self.num_envs, self.model.nu)
        if control.shape != shape or not control.is_floating_point():
            raise ValueError(
                f"an action is the hinges' targets (rad), floating-point numbers of shape {shape},"
                f" robots and hinges; got {control.dtype} of shape {tuple(control.shape)}"
            )

    def _any(self, wrong: torch.Tensor) -> bool:
        """Whether a copy went wrong; the only place where the host waits for a device."""
        return bool(wrong.any())

    def _put_back(
        self, start: torch.Tensor, history: torch.Tensor | None, wrong: torch.Tensor
    ) -> None:
        lost = ~start[:, :3].isfinite().all(1) | self._bounds.beyond(start, start, 0)
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
        self._require_open()
        set_delay(self, "actuator", latency, "disturbances.latency")

    def set_sensor_latency(self, latency: torch.Tensor | float) -> None:
        """Sets how late the sensors are that remember; as for :meth:`set_latency`."""
        self._require_open()
        set_delay(self, "sensor", latency, "disturbances.sensor_latency")


def _require_walker(model: mujoco.MjModel) -> None:
    hinges = model.jnt_type[1:] == mujoco.mjtJoint.mjJNT_HINGE
    if not model.njnt or model.jnt_type[0] != mujoco.mjtJoint.mjJNT_FREE or not hinges.all():
        raise ValueError("the model's joints must be a free one, then hinges")
