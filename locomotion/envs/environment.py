"""The task as TorchRL knows it, with all robots stepped together."""

from __future__ import annotations

import contextlib
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.envs import EnvBase

from locomotion.disturbances import DisturbancesConfig
from locomotion.disturbances.runtime import Disturbances
from locomotion.envs.divergence import Divergence, DivergenceLog
from locomotion.envs.episodes import Episodes
from locomotion.envs.making import task_and_physics
from locomotion.envs.observables import add_observables
from locomotion.envs.sensing import Sensing
from locomotion.envs.specs import FLAGS, READINGS, make_flags, make_specs
from locomotion.physics import Physics, make_physics
from locomotion.physics.options import PhysicsConfig
from locomotion.robots.body import RobotConfig
from locomotion.tasks import RobotState, WalkAway, compile_model
from locomotion.tasks.options import EnvConfig, substeps


class LocomotionEnv(EnvBase):
    """Many copies of a modular robot in its task; by default they are paid for walking away.

    The action is the hinges' targets (rad), clipped to the task's limit inside, in the order of
    :attr:`hinge_names`. Next to reward and done flags the environment writes the readings of
    :mod:`locomotion.envs.readings` that it is asked for, each of shape ``(num_envs, size)``.

    Episodes do not end unless ``time_limit`` is given or the simulation diverges; then the step is
    ``terminated``, its reward 0, and its last observation the one before. Each episode begins with
    random hinge targets, uniform within the limit, and a while to settle.

    A reward of your own is a reward of the task (see :mod:`locomotion.tasks.rewards`), or
    :meth:`reward` in a subclass.

    Args:
        task: the task, with its robot and arena; or for short a robot that walks away on flat ground:
            a name from ``conf/robot``, the path of a YAML file, a :class:`RobotConfig`, or a mapping
            with ``name`` and ``body``.
        num_envs: number of robots, the environment's batch size.
        readings: names of the readings to write; one that is left out costs nothing.
        physics: how robots are stepped, and for a task in short form the properties of modules: a
            :class:`PhysicsConfig`, or some of its keys.
        disturbances: what disturbs robots: a :class:`DisturbancesConfig`, or some of its keys.
        time_limit: length of an episode (s), truncated then; ``None`` for a continuing task.
        stagger: whether a reset of all robots starts each at a random time of its episode.
        seed: of the random targets at the start; ``None`` draws one from torch's generator.
        settings: for a task in short form, keys of :class:`EnvConfig`.

    Raises:
        ConfigError: for what is unknown or out of range, or physics that this machine cannot do.
    """

    batch_locked = True

    def __init__(
        self,
        task: WalkAway | str | Path | RobotConfig | Mapping[str, Any] = "gecko",
        num_envs: int = 64,
        *,
        readings: Sequence[str] = READINGS,
        physics: PhysicsConfig | Mapping[str, Any] | None = None,
        disturbances: DisturbancesConfig | Mapping[str, Any] | None = None,
        time_limit: float | None = None,
        stagger: bool = False,
        seed: int | None = None,
        **settings: Any,
    ) -> None:
        settings = {"num_envs": num_envs, **settings}
        task, physics, disturbances = task_and_physics(task, physics, disturbances, settings)
        period = task.control_timestep
        num_envs = int(num_envs)  # a whole number of any kind, as has been checked
        limits = EnvConfig(num_envs, control_frequency=1 / period, time_limit=time_limit)
        self._sensing = Sensing(readings)
        # On the CPU TorchRL need not be told: it would look at every tensor for nothing.
        device = None if physics.device == "cpu" else physics.device
        super().__init__(device=device, batch_size=[num_envs])
        self._task = task
        add_observables(task, tuple(readings))
        sensor_latency = disturbances.ends("sensor_latency")[1]
        model = compile_model(task, self._sensing.needs_sensors, sensor_latency)
        self._physics = make_physics(model, num_envs, physics)
        self._disturbances = Disturbances(disturbances, task, self._physics)
        self._substeps = substeps(1 / period, task.physics_timestep)
        at = self._physics.device
        self._episodes = Episodes(num_envs, at, limits.step_limit, task.compass, stagger)
        self._work = torch.zeros(num_envs, dtype=torch.float64, device=at)
        self._divergences = DivergenceLog()
        self._hooks: list[Callable[[Physics], None]] = []
        if task.needs_work:
            self._physics.field("actuator_force")
        # From the first step on physics computes all that is read.
        self.observe()
        task.reward(self._before(), self.state)
        for name, spec in make_specs(task, self._sensing, num_envs, at).items():
            setattr(self, name, spec)
        self._set_seed(seed)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_hooks": []}  # a hook is of its block alone

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        add_observables(self._task, tuple(self._sensing))

    def extra_repr(self) -> str:
        """The robot, how many there are, what steps them, what is read and what is paid, for ``repr()``."""
        robot, rewards = self._task.robot.mjcf_model.model, self._task.rewards
        return (
            f"robot={robot!r}, num_envs={self.num_envs}, physics={self._physics!r},\n"
            f"readings={list(self._sensing)},\nrewards={[type(paid).__name__ for paid in rewards]}"
        )

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model that all robots share."""
        return self._physics.model

    @property
    def physics(self) -> Physics:
        """The stepping of the robots, with their positions and velocities as they are now."""
        return self._physics

    @property
    def task(self) -> WalkAway:
        """The dm-control task that the model was compiled from, for ``composer.Environment``."""
        return self._task

    @property
    def num_envs(self) -> int:
        """Number of robots."""
        return self.batch_size[0]

    @property
    def hinge_names(self) -> tuple[str, ...]:
        """The hinges' paths in the body, in the order of actions and of readings."""
        return tuple(self._task.robot.hinges)

    @property
    def state(self) -> RobotState:
        """The robots as they are now; what it holds changes with the next step."""
        return self._state_of(self._physics.field)

    def _state_of(self, field: Callable[[str], torch.Tensor]) -> RobotState:
        work = self._work if self._task.needs_work else None
        began = (self._episodes.start, work, self._episodes.heading)
        return RobotState(self._task, self.model, field, *began, self._disturbances.drawn)

    def _set_seed(self, seed: int | None) -> None:
        # On the CPU wherever the robots are, so that they start in the same way.
        seed = torch.randint(2**31, (), device="cpu") if seed is None else seed
        self._generator = torch.Generator("cpu").manual_seed(operator.index(seed))
        self._disturbances.seed(operator.index(seed))

    def _reset(
        self, tensordict: TensorDictBase | None = None, *, seed: int | None = None, **others: Any
    ) -> TensorDict:
        if others:
            raise TypeError(f"reset() of {type(self).__name__} takes seed, not {', '.join(others)}")
        if seed is not None:
            self._set_seed(seed)
        where = None if tensordict is None else tensordict.get("_reset", None)
        if where is not None:
            where = where.reshape(self.num_envs)
        rows = slice(None) if where is None else where
        # Targets are drawn for all robots, so that a partial reset uses up as much randomness.
        limit, device = self._task.target_limit, self._physics.device
        targets = torch.empty(self.num_envs, self.model.nu, dtype=torch.float64, device="cpu")
        targets = targets.uniform_(-limit, limit, generator=self._generator).to(device)
        self._physics.reset(where)
        poses = self._task.draw_starts(self.num_envs, self._generator)
        if poses is not None:
            self._physics.qpos[rows, :7] = poses.to(device)[rows]
        if where is None:
            self._disturbances.draw()
        targets = self._disturbances.begin(targets, rows)
        self._episodes.face(self.state, rows)
        diverged = self._physics.step(targets, self._task.settle_steps, where)
        self._divergences.note(diverged, self._physics, targets)
        if not self._task.settle_steps:
            self._physics.forward(where)
        self._episodes.begin(self._physics.qpos[:, :2], rows)
        if where is None:
            self._episodes.stagger(self._generator)
        return self._result(*make_flags(self._physics))

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        action = tensordict.get("action", None)
        if not isinstance(action, torch.Tensor):
            wanted = f"hinge targets (rad) of shape {(self.num_envs, self.model.nu)}"
            raise KeyError(f"a step needs an entry 'action', a tensor of {wanted}; got {action!r}")
        if self._task.needs_work:
            self._work.zero_()
        watch = self._watch if self._hooks or self._task.needs_work else None
        targets = self._disturbances.before_step(action)
        diverged = self._physics.step(targets, self._substeps, watch=watch)
        self._divergences.note(diverged, self._physics, action)
        reward = self.reward(self._before(), self.state).to(torch.float32).unsqueeze(-1)
        done, terminated, truncated = make_flags(self._physics)
        if diverged is not None:
            terminated[:, 0] = diverged
            reward.masked_fill_(terminated, 0.0)
        self._episodes.step(truncated)
        if diverged is not None or self._episodes.step_limit is not None:
            truncated &= ~terminated
            torch.logical_or(terminated, truncated, out=done)
        return self._result(done, terminated, truncated, reward=reward)

    def _result(self, *flags: torch.Tensor, **reward: torch.Tensor) -> TensorDict:
        found = {**self.observe(), **reward, **dict(zip(FLAGS, flags))}
        return TensorDict(found, batch_size=self.batch_size, device=self.device)

    def _before(self) -> RobotState:
        motion, nq = self._physics.previous, self.model.nq
        parts = {"time": motion[:, 0], "qpos": motion[:, 1 : 1 + nq], "qvel": motion[:, 1 + nq :]}
        return RobotState(self._task, self.model, parts.__getitem__, self._episodes.start)

    def reward(self, before: RobotState, after: RobotState) -> torch.Tensor:
        """Pays robots for a control step; by default the rewards of the task.

        Args:
            before: time, positions and velocities before it.
            after: the robots after it. Those that diverged are where they were, and get nothing.

        Returns:
            Shape ``(num_envs,)``.
        """
        return self._task.reward(before, after)

    def observe(self) -> dict[str, torch.Tensor]:
        """The readings now, by name, as sensors tell them; tensors of their own."""
        return self._sensing(self._state_of(self._disturbances.sensed()))

    @contextlib.contextmanager
    def after_substep(self, hook: Callable[[Physics], None]) -> Iterator[None]:
        """Has a function called after every physics step of the control steps taken in the block.

        To see what happens between two observations: the physics steps come out as they would without,
        but are taken one at a time, which costs speed.
        """
        self._hooks.append(hook)
        try:
            yield
        finally:
            self._hooks.remove(hook)

    def _watch(self, physics: Physics) -> None:
        if self._task.needs_work:
            self._work += physics.hinge_work()
        for hook in self._hooks:
            hook(physics)

    def take_divergences(self) -> list[Divergence]:
        """The divergences since this was last asked, at most the last thousand."""
        return self._divergences.take()

    def set_state(
        self, qpos: torch.Tensor, qvel: torch.Tensor, where: torch.Tensor | None = None
    ) -> None:
        """Puts robots into a state, in which their episode begins; no target is under way.

        Args:
            qpos: generalised positions, shape ``(num_envs, nq)`` or what is broadcast to it.
            qvel: generalised velocities, shape ``(num_envs, nv)`` likewise.
            where: which robots, bool of shape ``(num_envs,)``; ``None`` means all.
        """
        rows = slice(None) if where is None else where
        time = self._task.settle_steps * self._task.physics_timestep
        self._physics.put(time, qpos, qvel, where)
        self._episodes.face(self.state, rows)
        self._disturbances.begin(self._physics.control, rows)
        self._episodes.begin(self._physics.qpos[:, :2], rows)

    def get_extra_state(self) -> dict[str, Any]:
        """All that decides what comes next, for :meth:`~torch.nn.Module.state_dict`."""
        return {
            "physics": self._physics.state_dict(),
            "episodes": self._episodes.state_dict(),
            "generator": self._generator.get_state(),
            "disturbances": self._disturbances.state_dict(),
        }

    def set_extra_state(self, state: Mapping[str, Any]) -> None:
        self._physics.load_state_dict(state["physics"])
        self._episodes.load_state_dict(state["episodes"])
        self._generator.set_state(state["generator"])
        self._disturbances.load_state_dict(state["disturbances"])

    def close(self, **kwargs: Any) -> None:
        self._physics.close()
        super().close(**kwargs)
