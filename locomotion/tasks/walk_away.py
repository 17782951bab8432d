"""The task as dm-control knows it: the source of the model that every way of stepping shares."""

from __future__ import annotations

import operator
import pickle
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
import torch
from dm_control import composer, mjcf
from dm_control.composer.observation import observable
from dm_env import specs

from locomotion.arenas.ground import Ground
from locomotion.arenas.periodic import put_under
from locomotion.arenas.terrain import Terrain
from locomotion.robots.modular_robot import ModularRobot
from locomotion.tasks.options import TIMESTEP, EnvConfig, Integrator, Start, delay_for
from locomotion.tasks.rewards import Distance, Reward
from locomotion.tasks.starts import any_poses, spread, upright_poses
from locomotion.tasks.state import RobotState
from locomotion.tasks.touch import TouchMap, add_touch_sensors
from locomotion.tasks.work import hinge_work

_DEFAULTS = EnvConfig()
#: What makes contacts with a geom other than MuJoCo's default, but for its friction.
_CONTACT_PROPERTIES = {
    *("dclass", "contype", "conaffinity", "condim", "priority", "solmix", "solref", "solimp"),
    *("margin", "gap"),
}


class WalkAway(composer.Task):
    """Walk away from the start, or whatever else the rewards pay for.

    For ``composer.Environment`` and dm-control's viewer; :class:`~locomotion.envs.LocomotionEnv` steps
    many copies of the same compiled model. An episode starts with random hinge targets and a short while
    to settle, and does not end by itself.

    Args:
        robot: the robot, already built.
        arena: what it walks on, with ``ground_geoms``; a new :class:`~locomotion.arenas.ground.Ground`
            by default. What else is in the way is to be there before the task is made.
        rewards: what is paid for, added up; by default the distance from the start gained.
        control_timestep: time between actions (s).
        physics_timestep: length of a physics step (s); must divide ``control_timestep``.
        settle_time: how long the robot settles at the start (s).
        start: pose of the core at the start, before it settles.
        overturned: how many of the starts of ``Start.any`` are overturned, 0 to 1.
        compass: whether orientations tell the heading in the world, or that from the start.
        target_limit: hinge targets are clipped to so much to either side (rad).
        latency: how late hinges get their targets (s). MuJoCo keeps the targets that are under way.
            Robots that are stepped together may each have a shorter one, through
            :meth:`Physics.set_latency() <locomotion.physics.Physics.set_latency>`.
        integrator: MuJoCo's, of velocities.
        clock_frequency: of the reading ``phase_clock`` (Hz).

    Attributes:
        made_by: makes a task like this one anew, as :func:`~locomotion.envs.make_task` sets it; a task
            without it can neither be copied nor sent to another process.
    """

    made_by: Callable[[], WalkAway] | None = None

    def __init__(
        self,
        robot: ModularRobot,
        arena: composer.Arena | None = None,
        *,
        rewards: Sequence[Reward] | None = None,
        control_timestep: float = 1 / _DEFAULTS.control_frequency,
        physics_timestep: float = TIMESTEP,
        settle_time: float = _DEFAULTS.settle_time,
        start: Start = _DEFAULTS.start,
        overturned: float = _DEFAULTS.overturned,
        compass: bool = _DEFAULTS.compass,
        target_limit: float = _DEFAULTS.target_limit,
        latency: float = 0.0,
        integrator: Integrator = Integrator.implicitfast,
        clock_frequency: float = _DEFAULTS.clock_frequency,
    ) -> None:
        self.robot = robot
        #: Tells which contact sensors are whose: see :class:`~locomotion.tasks.touch.TouchMap`.
        self.touch_map = TouchMap(robot)
        self.rewards = (Distance(),) if rewards is None else tuple(rewards)
        self.settle_time = settle_time
        self.start = start
        self.overturned = overturned
        self.compass = compass
        self.target_limit = target_limit
        self.clock_frequency = clock_frequency
        self._arena = Ground() if arena is None else arena
        plain = _is_plain(self._arena)
        frame = self._arena.add_free_entity(robot)
        frame.pos = (0.0, 0.0, robot.standing_height)
        if plain:
            self._name_contacts()
        add_touch_sensors(robot, self._arena)
        for actuator in robot.actuators:
            actuator.ctrlrange = (-target_limit, target_limit)  # MuJoCo clips the targets
            if latency:
                samples = int(np.ceil(latency / physics_timestep - 1e-9)) + 1
                delay = delay_for(latency, physics_timestep)
                actuator.set_attributes(delay=delay, nsample=samples, interp="zoh")
        option = self._arena.mjcf_model.option
        option.timestep = physics_timestep
        option.integrator = integrator.value
        option.flag.island = "disable"  # one robot is one island
        # A state alone decides what comes next, however many steps are taken at a time; and for so
        # few contacts a warm start costs more than it saves.
        option.flag.warmstart = "disable"
        self.set_timesteps(control_timestep, physics_timestep)
        self._observables: dict[str, observable.Observable] = {}
        self._start = torch.zeros(1, 2, dtype=torch.float64, device="cpu")
        self._start_heading = None if compass else torch.zeros_like(self._start[:, 0])
        self._work: torch.Tensor | None = None
        self._felt: np.ndarray | None = None

    def _name_contacts(self) -> None:
        """Says the contacts that there can be as explicit pairs.

        This spares the search for pairs of geoms that might touch, and gives the same contacts. Leaving
        out end plates behind bricks changes contacts a little and gaits by less than 2%
        (reproduction/same_gait.py).
        """
        (ground,) = self._arena.ground_geoms
        geoms = self.robot.mjcf_model.find_all("geom")
        touching = [geom for geom in geoms if geom not in self.robot.covered_geoms]
        on_ground = 1.0 if ground.friction is None else ground.friction[0]
        for geom in touching:
            sliding = max(on_ground, geom.friction[0])
            self._arena.mjcf_model.contact.add(
                "pair", geom1=ground, geom2=geom, condim=3, friction=(sliding, sliding)
            )
        # MuJoCo leaves out pairs within a body, and between a body and its parent, which a hinge lets
        # overlap.
        limbs = touching if self.robot.self_collision else ()
        for geom in geoms:
            geom.set_attributes(contype=2 * (geom in limbs), conaffinity=2 * (geom in limbs))
        for exclusion in self.robot.mjcf_model.contact.get_children("exclude"):
            exclusion.remove()  # a body that is named here is not fused with its parent

    def __reduce__(self) -> tuple[Any, ...]:
        # dm-control's entities hold weak references to one another, which cannot be copied.
        if self.made_by is None:
            raise pickle.PicklingError(
                "a task that make_task() did not make cannot be copied or sent to another process; make"
                " task and environment there, or give the task made_by, a function that makes it"
            )
        if _model_of(self.made_by()) != _model_of(self):
            raise pickle.PicklingError(
                "a task whose robot or arena was changed after it was made cannot be copied or sent to"
                " another process; make task and environment there"
            )
        kept = ("made_by", "rewards", "settle_time", "target_limit", "clock_frequency")
        return operator.call, (self.made_by,), {name: getattr(self, name) for name in kept}

    @property
    def root_entity(self) -> composer.Arena:
        return self._arena

    @property
    def task_observables(self) -> dict[str, observable.Observable]:
        """Observables by name; an environment fills it from the table of readings."""
        return self._observables

    @property
    def settle_steps(self) -> int:
        """Physics steps for which the robot settles at the start."""
        return round(self.settle_time / self.physics_timestep)

    @property
    def needs_work(self) -> bool:
        """Whether a reward asks for the work of the hinges."""
        return any(reward.NEEDS_WORK for reward in self.rewards)

    def reward(self, before: RobotState, after: RobotState) -> torch.Tensor:
        """The rewards of a control step, added up, shape ``(robots,)``."""
        total = after.xy.new_zeros(len(after.xy))
        for reward in self.rewards:
            paid = reward(before, after)
            total = total + (paid if reward.weight == 1.0 else reward.weight * paid)
        return total

    def state(self, physics: mjcf.Physics) -> RobotState:
        """The robot of a dm-control environment, as the only row."""

        def field(name: str) -> torch.Tensor:
            felt = name == "sensordata" and self._felt is not None
            value = self._felt if felt else getattr(physics.data, name)
            return torch.tensor(np.asarray(value), dtype=torch.float64, device="cpu")[None]

        return RobotState(
            self, physics.model.ptr, field, self._start, self._work, self._start_heading
        )

    def draw_starts(self, count: int, generator: torch.Generator) -> torch.Tensor | None:
        """Draws where cores start.

        Args:
            count: of starts.
            generator: on the CPU.

        Returns:
            Places (m) and unit quaternions w x y z, float64 of shape ``(count, 7)``; ``None`` where all
            start as the model is, upright on flat ground.
        """
        uneven = isinstance(self._arena, Terrain)
        if self.start is Start.any:
            poses = any_poses(self.robot, count, self.overturned, generator)
        elif uneven:
            poses = upright_poses(self.robot, count)
        else:
            return None
        return spread(poses, self.robot, self._arena, generator) if uneven else poses

    def action_spec(self, physics: mjcf.Physics) -> specs.BoundedArray:
        """Targets of all hinges (rad), in the order of ``robot.hinges``."""
        limit, shape = self.target_limit, (len(self.robot.hinges),)
        return specs.BoundedArray(shape, np.float64, -limit, limit, name="hinge_target")

    def initialize_episode(
        self, physics: mjcf.Physics, random_state: np.random.RandomState
    ) -> None:
        generator = torch.Generator().manual_seed(int(random_state.randint(2**31)))
        poses = self.draw_starts(1, generator)
        if poses is not None:
            physics.data.qpos[:7] = poses[0].numpy()
        if self._start_heading is not None:
            self._start_heading = self.state(physics).heading
        limit = self.target_limit
        targets = random_state.uniform(-limit, limit, len(self.robot.hinges))
        physics.bind(self.robot.actuators).ctrl = targets
        self._felt = None
        put_under(physics.model.ptr, physics.data.ptr)
        for _ in range(self.settle_steps):
            self._feel(physics)
            physics.step()
        self._start = torch.from_numpy(physics.data.qpos[None, :2].copy())
        self._reward = 0.0

    def before_step(
        self, physics: mjcf.Physics, action: np.ndarray, random_state: np.random.RandomState
    ) -> None:
        physics.bind(self.robot.actuators).ctrl = action
        put_under(physics.model.ptr, physics.data.ptr)
        # Nothing derived is left over from a reset, which dm-control ends with actuation disabled.
        mujoco.mj_step1(physics.model.ptr, physics.data.ptr)
        field = self.state(physics).field
        parts = {name: field(name) for name in ("time", "qpos", "qvel")}
        self._before = RobotState(self, physics.model.ptr, parts.__getitem__, self._start)
        self._work = torch.zeros_like(self._start[:, 0]) if self.needs_work else None
        self._speeds = parts["qvel"]

    def before_substep(
        self, physics: mjcf.Physics, action: np.ndarray, random_state: np.random.RandomState
    ) -> None:
        self._feel(physics)

    def _feel(self, physics: mjcf.Physics) -> None:
        # After a step dm-control looks for the contacts of the next one, if it is not told otherwise.
        self._felt = physics.data.sensordata.copy() if physics.legacy_step else None

    def after_substep(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        if self._work is not None:
            speeds = torch.from_numpy(physics.data.qvel[None].copy())
            force = torch.from_numpy(physics.data.actuator_force[None].copy())
            model = physics.model.ptr
            self._work += hinge_work(
                lambda name: torch.from_numpy(getattr(model, name))[None],
                model.opt.timestep,
                force,
                self._speeds,
                speeds,
            )
            self._speeds = speeds

    def after_step(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self._reward = self.reward(self._before, self.state(physics)).item()

    def get_reward(self, physics: mjcf.Physics) -> float:
        """The reward of the last control step."""
        return self._reward


def _model_of(task: WalkAway) -> str:
    return task.root_entity.mjcf_model.to_xml_string()


def _is_plain(arena: composer.Arena) -> bool:
    """Whether an arena has nothing to touch but one geom, with MuJoCo's default contacts."""
    geoms, default = arena.mjcf_model.find_all("geom"), arena.mjcf_model.default.geom
    return (
        geoms == list(arena.ground_geoms)
        and len(geoms) == 1
        and not (default and default.get_attributes())
        and not geoms[0].get_attributes().keys() & _CONTACT_PROPERTIES
    )
