"""A task from options: what ``robot``, ``arena``, ``task``, ``env`` and ``physics`` describe."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from locomotion.disturbances import NONE, DisturbancesConfig
from locomotion.options import ConfigError, arenas, chosen, typed
from locomotion.physics.options import PhysicsConfig
from locomotion.robots.body import RobotConfig, load_robot
from locomotion.robots.modular_robot import ModularRobot
from locomotion.tasks.options import EnvConfig, TaskConfig, substeps
from locomotion.tasks.rewards import make_rewards
from locomotion.tasks.walk_away import WalkAway


def make_task(
    robot: RobotConfig,
    arena: Mapping[str, Any] | None = None,
    task: TaskConfig | None = None,
    env: EnvConfig | None = None,
    physics: PhysicsConfig | None = None,
    disturbances: DisturbancesConfig = NONE,
) -> WalkAway:
    """Builds a robot, its arena and its task.

    Args:
        robot: name and body.
        arena: ``name`` of an arena and its options; flat ground by default.
        task: rewards; the report's by default.
        env: episodes and actions; the report's by default.
        physics: timestep, and properties of the modules.
        disturbances: their latency of targets; the rest is the environment's.

    Raises:
        ConfigError: for an unknown name or option, or a value out of range.
    """
    made_by = functools.partial(make_task, robot, arena, task, env, physics, disturbances)
    env, physics = env or EnvConfig(), physics or PhysicsConfig()
    substeps(env.control_frequency, physics.timestep)  # raises what dm-control says less plainly
    ground = chosen(arenas, arena or {"name": "ground"}, "arena").make(physics.friction)
    body = ModularRobot(
        robot.body,
        name=robot.name,
        friction=physics.friction,
        stiffness=physics.stiffness,
        damping=physics.damping,
        armature=physics.armature,
        self_collision=physics.self_collision,
    )
    made = WalkAway(
        body,
        ground,
        rewards=None if task is None else make_rewards(task.rewards),
        control_timestep=1 / env.control_frequency,
        physics_timestep=physics.timestep,
        settle_time=env.settle_time,
        start=env.start,
        overturned=env.overturned,
        compass=env.compass,
        target_limit=env.target_limit,
        latency=disturbances.ends("latency")[1],
        integrator=physics.integrator,
        clock_frequency=env.clock_frequency,
    )
    made.made_by = made_by
    return made


def task_and_physics(
    task: WalkAway | str | Path | RobotConfig | Mapping[str, Any],
    physics: PhysicsConfig | Mapping[str, Any] | None,
    disturbances: DisturbancesConfig | Mapping[str, Any] | None,
    settings: Mapping[str, Any],
) -> tuple[WalkAway, PhysicsConfig, DisturbancesConfig]:
    """The task that an environment was given or that its short form stands for, and what goes with it.

    Raises:
        ConfigError: for options that cannot be used; a task that is given has settings of its own.
    """
    if not isinstance(physics, PhysicsConfig):
        physics = typed(PhysicsConfig, dict(physics or {}))
    if not isinstance(disturbances, DisturbancesConfig):
        disturbances = typed(DisturbancesConfig, dict(disturbances or {}))
    env = typed(EnvConfig, dict(settings))
    if not isinstance(task, WalkAway):
        made = make_task(load_robot(task), env=env, physics=physics, disturbances=disturbances)
        return made, physics, disturbances
    others = sorted(settings.keys() - {"num_envs"})
    if others:
        raise ConfigError(f"{others[0]} is a setting of the task, which was given")
    return task, physics, disturbances
