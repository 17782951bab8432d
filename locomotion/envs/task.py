"""The task as dm-control knows it: the source of the model that every way of stepping shares."""

from __future__ import annotations

import mujoco
import numpy as np
from dm_control import composer, mjcf
from dm_env import specs

from locomotion.envs.ground import Ground
from locomotion.robots import ModularRobot


class WalkAway(composer.Task):
    """Walk away from the start: the reward is the distance from it gained in a control step.

    For ``composer.Environment`` and dm-control's viewer. Training steps the same compiled model in
    :class:`~locomotion.envs.LocomotionEnv`. An episode starts with random hinge targets and a short
    while to settle, and never ends by itself.

    Args:
        robot: the robot, already built.
        control_timestep: time between actions (s).
        physics_timestep: length of a physics step (s); must divide ``control_timestep``.
        settle_time: how long the robot settles at the start (s).
        friction: sliding friction of the ground.
        self_collision: whether the robot's modules collide with one another; those on both sides of
            a hinge never do.
        target_limit: hinge targets are clipped to so much to either side (rad).
    """

    def __init__(
        self,
        robot: ModularRobot,
        control_timestep: float = 0.25,
        physics_timestep: float = 0.01,
        settle_time: float = 0.5,
        friction: float = 1.0,
        self_collision: bool = False,
        target_limit: float = 1.0,
    ) -> None:
        self._robot = robot
        self._target_limit = target_limit
        self._settle_time = settle_time
        self._arena = Ground(friction=friction)
        frame = self._arena.add_free_entity(robot)
        frame.pos = (0.0, 0.0, robot.standing_height)
        self._stand_on_ground(friction)
        if self_collision:
            self._collide_with_itself()
        for actuator in robot.actuators:
            actuator.ctrlrange = (-target_limit, target_limit)  # MuJoCo clips the targets
        option = self._arena.mjcf_model.option
        option.integrator = "implicitfast"
        option.flag.island = "disable"  # one robot is one island
        # A state alone decides what comes next, however many steps are taken at a time; and for so
        # few contacts a warm start costs more than it saves.
        option.flag.warmstart = "disable"
        self.set_timesteps(control_timestep, physics_timestep)
        for sensed in (robot.observables.hinge_position, robot.observables.core_orientation):
            sensed.enabled = True
        self._start = np.zeros(2)
        self._distance = 0.0
        self._reward = 0.0

    def _stand_on_ground(self, friction: float) -> None:
        # Modules touch nothing but the ground. Said as explicit pairs, this spares the search for
        # pairs of geoms that might touch, and gives the same contacts. Leaving out end plates behind
        # bricks changes contacts a little and gaits by less than 2% (benchmarks/same_gait.py).
        (ground,) = self._arena.ground_geoms
        for geom in self._robot.mjcf_model.find_all("geom"):
            if geom not in self._robot.covered_geoms:
                sliding = max(friction, geom.friction[0])
                self._arena.mjcf_model.contact.add(
                    "pair",
                    geom1=ground,
                    geom2=geom,
                    condim=3,
                    friction=(sliding, sliding, *geom.friction[[1, 2, 2]]),
                )
            geom.conaffinity = 0

    def _collide_with_itself(self) -> None:
        # A type of contact that the ground has no part in. MuJoCo leaves out pairs within a body, and
        # between a body and its parent, which a hinge lets overlap.
        for geom in self._robot.mjcf_model.find_all("geom"):
            if geom not in self._robot.covered_geoms:
                geom.set_attributes(contype=2, conaffinity=2)

    @property
    def root_entity(self) -> Ground:
        return self._arena

    @property
    def robot(self) -> ModularRobot:
        """The robot that walks."""
        return self._robot

    def action_spec(self, physics: mjcf.Physics) -> specs.BoundedArray:
        """Targets of all hinges (rad), in the order of ``robot.hinges``."""
        limit, shape = self._target_limit, (len(self._robot.hinges),)
        return specs.BoundedArray(shape, np.float64, -limit, limit, name="hinge_target")

    def initialize_episode(
        self, physics: mjcf.Physics, random_state: np.random.RandomState
    ) -> None:
        limit = self._target_limit
        targets = random_state.uniform(-limit, limit, len(self._robot.hinges))
        physics.bind(self._robot.actuators).ctrl = targets
        for _ in range(round(self._settle_time / self.physics_timestep)):
            physics.step()
        self._start = self._position(physics)
        self._distance = 0.0
        self._reward = 0.0

    def before_step(
        self, physics: mjcf.Physics, action: np.ndarray, random_state: np.random.RandomState
    ) -> None:
        physics.bind(self._robot.actuators).ctrl = action
        # Nothing derived is left over from a reset, which dm-control ends with actuation disabled.
        mujoco.mj_step1(physics.model.ptr, physics.data.ptr)

    def after_step(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        distance = float(np.linalg.norm(self._position(physics) - self._start))
        self._reward = distance - self._distance
        self._distance = distance

    def get_reward(self, physics: mjcf.Physics) -> float:
        """Distance from the start gained in the last control step (m)."""
        return self._reward

    def _position(self, physics: mjcf.Physics) -> np.ndarray:
        return self._robot.get_pose(physics)[0][:2].copy()
