"""Sizes, masses and properties of the modules: the one place that holds them.

Figures are those of Revolve2's first modules. A module's frame has x pointing away from the
module that carries it; the core's frame sits at its centre, every other module's on the face by
which it is attached. Metres, kilograms and radians.
"""

import dataclasses
import math


@dataclasses.dataclass(frozen=True)
class Box:
    """A box with faces along its module's axes: centre (m), full lengths (m) and mass (kg)."""

    name: str
    centre: tuple[float, float, float]
    lengths: tuple[float, float, float]
    mass: float


@dataclasses.dataclass(frozen=True)
class Face:
    """A place to attach a child: a point (m), and the turn of its x axis about z.

    ``quarter_turns`` counts turns of 90 degrees from the module's own x axis, counter-clockwise
    seen from above.
    """

    position: tuple[float, float, float]
    quarter_turns: int


@dataclasses.dataclass(frozen=True)
class ModuleGeometry:
    """All that one kind of module is made of.

    Attributes:
        boxes: those that do not move against the parent.
        arm_boxes: those that move with the hinge; empty for rigid modules.
        joint: where the hinge's axis, parallel to y, crosses x (m); ``None`` for rigid modules.
        faces: where children go, by name. A hinge's face moves with its arm.
    """

    boxes: tuple[Box, ...]
    faces: dict[str, Face]
    arm_boxes: tuple[Box, ...] = ()
    joint: float | None = None


def _core() -> ModuleGeometry:
    length, height = 0.089, 0.0603
    half = length / 2
    return ModuleGeometry(
        boxes=(Box("core", (0.0, 0.0, 0.0), (length, length, height), 0.250),),
        faces={
            "front": Face((half, 0.0, 0.0), 0),
            "left": Face((0.0, half, 0.0), 1),
            "back": Face((-half, 0.0, 0.0), 2),
            "right": Face((0.0, -half, 0.0), 3),
        },
    )


def _brick() -> ModuleGeometry:
    length, height = 0.06288625, 0.0603
    half = length / 2
    return ModuleGeometry(
        boxes=(Box("brick", (half, 0.0, 0.0), (length, length, height), 0.030),),
        faces={
            "front": Face((length, 0.0, 0.0), 0),
            "left": Face((half, half, 0.0), 1),
            "right": Face((half, -half, 0.0), 3),
        },
    )


def _hinge() -> ModuleGeometry:
    frame = Box("frame", (0.04525 / 2, 0.0, 0.0), (0.04525, 0.053, 0.0165891), 0.011)
    frame_x = frame.centre[0]
    servo = Box("servo", (frame_x + 0.0299, 0.0, 0.0), (0.0583, 0.0512, 0.020), 0.058)
    servo_end = servo.centre[0] + servo.lengths[0] / 2
    plate = Box("end_plate", (servo_end + 0.001, 0.0, 0.0), (0.002, 0.053, 0.053), 0.0)
    return ModuleGeometry(
        boxes=(frame,),
        arm_boxes=(servo, plate),
        joint=frame_x + 0.0119,
        faces={"attachment": Face((servo_end + 0.002, 0.0, 0.0), 0)},
    )


GEOMETRY: dict[str, ModuleGeometry] = {"core": _core(), "brick": _brick(), "hinge": _hinge()}

#: Sliding friction of all surfaces.
FRICTION = 1.0
#: A hinge's servo: stiffness (N·m/rad), damping (N·m·s/rad), and inertia of its rotor (kg·m²).
STIFFNESS = 1.0
DAMPING = 0.05
ARMATURE = 0.002
#: How far a hinge turns to either side (rad), its largest torque (N·m) and its top speed (rad/s).
HINGE_RANGE = math.pi / 3
HINGE_TORQUE = 0.948013269
HINGE_SPEED = 6.338968228
