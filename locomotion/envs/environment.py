"""The task as TorchRL knows it, with all robots stepped together."""

from __future__ import annotations

import collections
import contextlib
import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from locomotion.config import (
    ConfigError,
    EnvConfig,
    PhysicsConfig,
    RobotConfig,
    load,
    load_file,
    substeps,
    typed,
)
from locomotion.envs.task import WalkAway
from locomotion.physics import Physics, make_physics
from locomotion.robots import ModularRobot

#: How many divergences are kept for :meth:`LocomotionEnv.take_divergences`.
MOST_DIVERGENCES = 1000

#: What the environment knows about its robots, by key; each reading is a tensor of its own.
OBSERVATIONS: dict[str, Callable[[Physics], torch.Tensor]] = {
    "hinge_position": lambda physics: physics.qpos[:, 7:].to(torch.float32),
    "hinge_velocity": lambda physics: physics.qvel[:, 6:].to(torch.float32),
    "core_orientation": lambda physics: physics.qpos[:, 3:7].to(torch.float32),
    "core_position": lambda physics: physics.qpos[:, :3].clone(),
}


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


class LocomotionEnv(EnvBase):
    """Many copies of a modular robot that are paid for walking away from where they started.

    The reward is ``d(t) - d(t - 1)`` with ``d`` the horizontal distance (m) of the core from its
    place when the episode began. Episodes do not end unless ``time_limit`` is given or the simulation
    diverges; then the step is ``terminated``, its reward 0, and its last observation the one before.
    Each episode begins with hinge targets drawn from U(-l, l) and a while to settle, ``l`` being
    ``target_limit``.

    The action is the hinges' targets (rad), clipped to [-l, l] inside, in the order of
    :attr:`hinge_names`. Beside reward and done flags the environment writes

    ==================== ================== ======= =============================================
    key                  shape              dtype   meaning
    ==================== ================== ======= =============================================
    ``hinge_position``   ``(n, hinges)``    float32 angles (rad)
    ``hinge_velocity``   ``(n, hinges)``    float32 angular velocities (rad/s)
    ``core_orientation`` ``(n, 4)``         float32 unit quaternion w x y z, core to world
    ``core_position``    ``(n, 3)``         float64 place in the world (m); robots walk kilometres
    ==================== ================== ======= =============================================

    Args:
        robot: a name from ``conf/robot``, the path of a YAML file, a :class:`RobotConfig`, or a
            mapping with ``name`` and ``body``.
        num_envs: number of robots, the environment's batch size.
        physics: how they are stepped: a :class:`PhysicsConfig`, or keys to change in
            ``conf/physics/threaded.yaml``, or in ``warp.yaml`` with ``backend="warp"`` among them.
        control_frequency: actions a second (Hz).
        settle_time: how long robots settle before an episode (s).
        time_limit: length of an episode (s), truncated then; ``None`` for a continuing task.
        target_limit: how far hinges can be sent to either side (rad).
        observations: which of the four entries to write; what is left out costs nothing.
        seed: of the random targets at the start; ``None`` draws one from torch's generator.

    Raises:
        ConfigError: for an unknown robot, a body that cannot exist, a value out of range, or physics
            that this machine cannot do.
    """

    batch_locked = True

    def __init__(
        self,
        robot: str | Path | RobotConfig | Mapping[str, Any] = "gecko",
        num_envs: int = 64,
        *,
        physics: PhysicsConfig | Mapping[str, Any] | None = None,
        control_frequency: float = 4.0,
        settle_time: float = 0.5,
        time_limit: float | None = None,
        target_limit: float = 1.0,
        observations: Sequence[str] = tuple(OBSERVATIONS),
        seed: int | None = None,
    ) -> None:
        task = EnvConfig(num_envs, control_frequency, settle_time, time_limit, target_limit)
        if not isinstance(physics, PhysicsConfig):
            physics = _physics_config(physics or {})
        # On the CPU TorchRL need not be told: it would look at every tensor for nothing.
        super().__init__(
            device=None if physics.device == "cpu" else physics.device, batch_size=[num_envs]
        )
        robot = _robot_config(robot)
        self._substeps = substeps(control_frequency, physics.timestep)
        self._target_limit = target_limit
        self._settle_steps = round(settle_time / physics.timestep)
        self._step_limit = task.step_limit
        self._task = WalkAway(
            ModularRobot(
                robot.body,
                name=robot.name,
                friction=physics.friction,
                stiffness=physics.stiffness,
                damping=physics.damping,
                armature=physics.armature,
                mass_scale=physics.mass_scale,
                strength_scale=physics.strength_scale,
            ),
            control_timestep=1 / control_frequency,
            physics_timestep=physics.timestep,
            settle_time=settle_time,
            friction=physics.friction,
            self_collision=physics.self_collision,
            target_limit=target_limit,
        )
        self._physics = make_physics(_compile(self._task), num_envs, physics)
        at = self._physics.device
        self._start = torch.zeros(num_envs, 2, dtype=torch.float64, device=at)
        self._distance = torch.zeros(num_envs, dtype=torch.float64, device=at)
        self._steps = torch.zeros(num_envs, dtype=torch.int64, device=at)
        self._divergences = collections.deque[Divergence](maxlen=MOST_DIVERGENCES)
        self._after_substep: list[Callable[[Physics], None]] = []
        self._observations = _chosen(observations)
        self._make_specs(num_envs, self.model.nu)
        self.set_seed(_random_seed() if seed is None else seed)

    def _make_specs(self, num_envs: int, num_hinges: int) -> None:
        batch = (num_envs,)
        device = self.device
        self.action_spec = Bounded(
            -self._target_limit,
            self._target_limit,
            shape=(num_envs, num_hinges),
            dtype=torch.float32,
            device=device,
        )
        self.observation_spec = Composite(
            {
                key: Unbounded(value.shape, dtype=value.dtype, device=device)
                for key, value in self.observe().items()
            },
            shape=batch,
            device=device,
        )
        self.reward_spec = Unbounded((num_envs, 1), device=device)
        flag = Binary(1, shape=(num_envs, 1), dtype=torch.bool, device=device)
        self.done_spec = Composite(
            done=flag,
            terminated=flag.clone(),
            truncated=flag.clone(),
            shape=batch,
            device=device,
        )

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model that all robots share."""
        return self._physics.model

    @property
    def physics(self) -> Physics:
        """What steps the robots, with their positions and velocities as they are now."""
        return self._physics

    @property
    def task(self) -> WalkAway:
        """The dm-control task that the model was compiled from, for ``composer.Environment``."""
        return self._task

    @property
    def hinge_names(self) -> tuple[str, ...]:
        """The hinges' paths in the body, in the order of actions and observations."""
        return tuple(self._task.robot.hinges)

    def _set_seed(self, seed: int | None) -> None:
        # On the CPU wherever the robots are, so that they start in the same way.
        self._generator = torch.Generator().manual_seed(_random_seed() if seed is None else seed)

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDict:
        where = None if tensordict is None else tensordict.get("_reset", None)
        if where is not None:
            where = where.reshape(self.num_envs)
        rows = slice(None) if where is None else where
        # Targets are drawn for all robots, so that a partial reset uses up as much randomness.
        targets = torch.empty(self.action_spec.shape, dtype=torch.float64)
        targets.uniform_(-self._target_limit, self._target_limit, generator=self._generator)
        targets = targets.to(self._physics.device)
        self._physics.reset(where)
        self._note(self._physics.step(targets, self._settle_steps, where), targets)
        self._start_here(rows)
        flags = dict(zip(("done", "terminated", "truncated"), self._flags()))
        return TensorDict(
            {**self.observe(), **flags}, batch_size=self.batch_size, device=self.device
        )

    def _start_here(self, rows: torch.Tensor | slice) -> None:
        self._start[rows] = self._physics.qpos[rows, :2]
        self._distance[rows] = 0.0
        self._steps[rows] = 0

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        place = self._start.new_empty(1, self.num_envs, 2)
        done, terminated, truncated = self._flags()
        ends = self.advance(tensordict.get("action"), place[0])
        reward = self.gains(place).T
        if ends is not None:
            terminated[:, 0], truncated[:, 0] = ends
            torch.logical_or(terminated, truncated, out=done)
            reward[terminated] = 0.0
        return TensorDict(
            {
                **self.observe(),
                "reward": reward,
                "done": done,
                "terminated": terminated,
                "truncated": truncated,
            },
            batch_size=self.batch_size,
            device=self.device,
        )

    def advance(
        self, action: torch.Tensor, place: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor] | None:
        """Takes a control step, for loops that compute rewards for many steps at a time.

        Args:
            action: hinge targets (rad), shape ``(num_envs, hinges)``.
            place: where to write where the cores then are on the ground (m), float64 of shape
                ``(num_envs, 2)``. It is owed to :meth:`gains`, before the next reset.

        Returns:
            Whose simulation diverged, which ends the episode without a reward, and who has reached
            the time limit, both bool of shape ``(num_envs,)``; ``None`` if nobody's episode ended.
        """
        diverged = self._note(self._take_substeps(action), action)
        place.copy_(self._physics.qpos[:, :2])
        if self._step_limit is None:
            return None if diverged is None else (diverged, torch.zeros_like(diverged))
        self._steps += 1
        late = self._steps >= self._step_limit
        if diverged is None:
            return (torch.zeros_like(late), late) if late.any() else None
        return diverged, late & ~diverged

    @contextlib.contextmanager
    def after_substep(self, hook: Callable[[Physics], None]) -> Iterator[None]:
        """Has a function called after every physics step of the control steps taken in the block.

        To see what happens between two observations: the physics steps come out as they would without,
        but are taken one at a time, which costs speed.
        """
        self._after_substep.append(hook)
        try:
            yield
        finally:
            self._after_substep.remove(hook)

    def _take_substeps(self, action: torch.Tensor) -> torch.Tensor | None:
        if not self._after_substep:
            return self._physics.step(action, self._substeps)
        diverged = sound = None
        for _ in range(self._substeps):
            wrong = self._physics.step(action, 1, sound)
            if wrong is not None:
                diverged = wrong if diverged is None else diverged | wrong
                sound = ~diverged
            for hook in self._after_substep:
                hook(self._physics)
        return diverged

    def _note(self, diverged: torch.Tensor | None, control: torch.Tensor) -> torch.Tensor | None:
        """Keeps what led robots to diverge."""
        if diverged is not None:
            for robot in diverged.nonzero().squeeze(-1).tolist():
                state = (self._physics.qpos, self._physics.qvel, control)
                copies = (entry[robot].to("cpu", copy=True) for entry in state)
                self._divergences.append(Divergence(robot, *copies))
        return diverged

    def take_divergences(self) -> list[Divergence]:
        """What led robots to diverge since this was last asked, the last :data:`MOST_DIVERGENCES`."""
        taken = list(self._divergences)
        self._divergences.clear()
        return taken

    def set_state(
        self, qpos: torch.Tensor, qvel: torch.Tensor, where: torch.Tensor | None = None
    ) -> None:
        """Puts robots into a state, in which their episode begins.

        Args:
            qpos: generalised positions, shape ``(num_envs, nq)`` or what is broadcast to it.
            qvel: generalised velocities, shape ``(num_envs, nv)`` likewise.
            where: which robots, bool of shape ``(num_envs,)``; ``None`` means all.
        """
        rows = slice(None) if where is None else where
        self._physics.qpos[rows] = qpos.to(self._physics.qpos)
        self._physics.qvel[rows] = qvel.to(self._physics.qvel)
        self._start_here(rows)

    def get_extra_state(self) -> dict[str, torch.Tensor]:
        """All that decides what comes next, for :meth:`~torch.nn.Module.state_dict`."""
        return {
            "qpos": self._physics.qpos.clone(),
            "qvel": self._physics.qvel.clone(),
            "start": self._start.clone(),
            "distance": self._distance.clone(),
            "steps": self._steps.clone(),
            "generator": self._generator.get_state(),
        }

    def set_extra_state(self, state: dict[str, torch.Tensor]) -> None:
        self._physics.qpos.copy_(state["qpos"])
        self._physics.qvel.copy_(state["qvel"])
        self._start.copy_(state["start"])
        self._distance.copy_(state["distance"])
        self._steps.copy_(state["steps"])
        self._generator.set_state(state["generator"])

    def gains(self, places: torch.Tensor) -> torch.Tensor:
        """Rewards (m) of the control steps that led to places, one after the other.

        Args:
            places: what :meth:`advance` wrote since the last call, shape ``(steps, num_envs, 2)``.

        Returns:
            Distance from the start gained in each step, float32 of shape ``(steps, num_envs)``.
        """
        distance = torch.linalg.vector_norm(places - self._start, dim=-1)
        gained = torch.diff(distance, dim=0, prepend=self._distance.unsqueeze(0))
        self._distance.copy_(distance[-1])
        return gained.to(torch.float32)

    def _flags(self) -> tuple[torch.Tensor, ...]:
        """Three flags that nobody has raised, bool of shape ``(num_envs, 1)``."""
        return self._start.new_zeros(3, self.num_envs, 1, dtype=torch.bool).unbind()

    def observe(self) -> dict[str, torch.Tensor]:
        """What the environment knows about its robots now, by key; tensors of their own."""
        return {key: read(self._physics) for key, read in self._observations.items()}

    @property
    def num_envs(self) -> int:
        """Number of robots."""
        return self.batch_size[0]

    def close(self, **kwargs: Any) -> None:
        if not self.is_closed:
            self._physics.close()
        super().close(**kwargs)


def _compile(task: WalkAway) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(task.root_entity.mjcf_model.to_xml_string())
    # Attachment sites have done their work, and each would be placed anew in every physics step.
    for site in list(spec.sites):
        spec.delete(site)
    return spec.compile()


def _chosen(observations: Sequence[str]) -> dict[str, Callable[[Physics], torch.Tensor]]:
    unknown = set(observations) - set(OBSERVATIONS)
    if unknown:
        raise ConfigError(
            f"observation {min(unknown)!r} is unknown; choose from {', '.join(OBSERVATIONS)}"
        )
    return {key: OBSERVATIONS[key] for key in observations}


def _physics_config(physics: Mapping[str, Any]) -> PhysicsConfig:
    return load(f"physics/{physics.get('backend', 'threaded')}", physics)


def _robot_config(robot: str | Path | RobotConfig | Mapping[str, Any]) -> RobotConfig:
    if isinstance(robot, RobotConfig):
        return robot
    if isinstance(robot, Mapping):
        return typed(RobotConfig, dict(robot))
    if isinstance(robot, Path) or robot.endswith((".yaml", ".yml")):
        return load_file(Path(robot), RobotConfig)
    return load(f"robot/{robot}")


def _random_seed() -> int:
    return int(torch.randint(2**31, ()))
