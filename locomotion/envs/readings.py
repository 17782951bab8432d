"""The table of readings: what a robot can sense.

A reading is one entry here, or in a package of yours (see :mod:`locomotion.options.registry`). Specs of
the environment, dm-control's observables, ``--help`` and exported policies follow from it, and
``conf/obs/*.yaml`` choose readings by their names.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from locomotion.disturbances.options import DEFAULTS
from locomotion.options import readings

if TYPE_CHECKING:
    import torch

    from locomotion.robots.symmetry import Mirror
    from locomotion.tasks.state import RobotState
    from locomotion.tasks.walk_away import WalkAway


@dataclasses.dataclass(frozen=True)
class Reading:
    """One thing that a robot can sense.

    Attributes:
        size: how many numbers it has, for a task.
        unit: of these numbers; empty without one.
        meaning: in words.
        read: the numbers, from the state of robots, shape ``(robots, size)``. The result may be a view.
        dtype: name of torch's dtype that they are given out in.
        quaternion: whether they are a unit quaternion w x y z, so that other representations of an
            orientation can be asked for.
        sensors: whether the model's sensors are read, which are left out of it otherwise.
        mirror: the matrix that maps the numbers of a robot to those of its mirror image, shape ``(size,
            size)``; ``None`` if none does, so that ``ppo.symmetry`` refuses it.
    """

    size: Callable[[WalkAway], int]
    unit: str
    meaning: str
    read: Callable[[RobotState], torch.Tensor]
    dtype: str = "float32"
    quaternion: bool = False
    sensors: bool = False
    mirror: Callable[[Mirror], np.ndarray] | None = None


#: Within this distance of the start (m) its direction fades out, as it would turn at every step.
_NEAR = 0.3


def _hinges(task: WalkAway) -> int:
    return len(task.robot.hinges)


def _hinges_mirrored(mirror: Mirror) -> np.ndarray:
    return mirror.hinge_matrix


def _vector_mirrored(mirror: Mirror) -> np.ndarray:
    return mirror.reflection


def _phase(state: RobotState) -> torch.Tensor:
    angle = 2 * math.pi * state.task.clock_frequency * state.seconds
    phase = angle.new_empty(len(angle), 2)
    phase[:, 0], phase[:, 1] = angle.cos(), angle.sin()
    return phase


def _course(state: RobotState) -> torch.Tensor:
    away = state.xy - state.start
    course = away.new_zeros(len(away), 3)
    course[:, :2] = away / away.norm(dim=-1, keepdim=True).clamp(min=_NEAR)
    return state.in_core_frame(course)


def _contact(state: RobotState) -> torch.Tensor:
    found = state.field("sensordata")
    touched = (found > 0).to(found) @ state.task.touch_map(state.model, found)
    return touched.clamp(max=1)


def _target(state: RobotState) -> torch.Tensor:
    limit = state.task.target_limit
    return state.field("ctrl").clamp(-limit, limit)


def _drawn(state: RobotState) -> torch.Tensor:
    if state.drawn is not None:
        return state.drawn
    qpos = state.field("qpos")
    return qpos.new_zeros(len(qpos), len(DEFAULTS))


_TABLE = {
    "hinge_position": Reading(
        _hinges,
        "rad",
        "angles of the hinges",
        lambda state: state.field("qpos")[:, 7:],
        mirror=_hinges_mirrored,
    ),
    "hinge_velocity": Reading(
        _hinges,
        "rad/s",
        "speeds of the hinges",
        lambda state: state.field("qvel")[:, 6:],
        mirror=_hinges_mirrored,
    ),
    "hinge_torque": Reading(
        _hinges,
        "N·m",
        "torques of the servos in the last physics step",
        lambda state: state.field("actuator_force"),
        mirror=_hinges_mirrored,
    ),
    "hinge_target": Reading(
        _hinges,
        "rad",
        "the targets that the hinges were last given, as clipped",
        _target,
        mirror=_hinges_mirrored,
    ),
    "core_orientation": Reading(
        lambda task: 4,
        "",
        "orientation of the core, a unit quaternion w x y z, core to world (see env.compass)",
        lambda state: state.sensed_orientation,
        quaternion=True,
        mirror=lambda mirror: mirror.quaternion_matrix,
    ),
    "core_angular_velocity": Reading(
        lambda task: 3,
        "rad/s",
        "angular velocity of the core in its own frame",
        lambda state: state.field("qvel")[:, 3:6],  # MuJoCo's free joints have it so
        mirror=lambda mirror: mirror.axial_matrix,
    ),
    "core_linear_velocity": Reading(
        lambda task: 3,
        "m/s",
        "velocity of the core in its own frame",
        lambda state: state.in_core_frame(state.field("qvel")[:, :3]),
        mirror=_vector_mirrored,
    ),
    "core_height": Reading(
        lambda task: 1,
        "m",
        "height of the core's centre in the world",
        lambda state: state.field("qpos")[:, 2:3],
        mirror=lambda mirror: np.eye(1),
    ),
    "core_position": Reading(
        lambda task: 3,
        "m",
        "place of the core in the world; robots walk kilometres",
        lambda state: state.field("qpos")[:, :3],
        dtype="float64",
        mirror=_vector_mirrored,
    ),
    "course": Reading(
        lambda task: 3,
        "",
        "direction from the start to the core in the core's frame; shorter than 1 within 0.3 m of it",
        _course,
        mirror=_vector_mirrored,
    ),
    "ground_contact": Reading(
        lambda task: len(task.robot.modules),
        "",
        "for each module 1 if it touched the ground in the last physics step, else 0",
        _contact,
        sensors=True,
        mirror=lambda mirror: mirror.module_matrix,
    ),
    "disturbances": Reading(
        lambda task: len(DEFAULTS),
        "",
        "how much of each disturbance is at work, from -1 to 1: for a critic, as no robot can sense it",
        _drawn,
        mirror=lambda mirror: np.eye(len(DEFAULTS)),
    ),
    "phase_clock": Reading(
        lambda task: 2,
        "",
        "cosine and sine of a clock that starts with the episode (env.clock_frequency)",
        _phase,
        mirror=lambda mirror: np.eye(2),
    ),
}

for _name, _reading in _TABLE.items():
    readings.register(_name)(_reading)
