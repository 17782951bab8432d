"""The three modules as composer entities: core, brick and active hinge."""

from __future__ import annotations

import math

from dm_control import composer, mjcf

from locomotion.robots.geometry import (
    ARMATURE,
    DAMPING,
    FRICTION,
    GEOMETRY,
    HINGE_RANGE,
    HINGE_TORQUE,
    STIFFNESS,
    Box,
    Face,
)

_COLOURS = {
    "core": (0.93, 0.60, 0.18, 1.0),
    "brick": (0.27, 0.48, 0.71, 1.0),
    "frame": (0.35, 0.35, 0.38, 1.0),
    "servo": (0.85, 0.26, 0.22, 1.0),
    "end_plate": (0.35, 0.35, 0.38, 1.0),
}


class _Module(composer.Entity):
    """Base class of the modules; a subclass builds the model and its attachment sites."""

    _mjcf_root: mjcf.RootElement
    _attachment_sites: dict[str, mjcf.Element]

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        return self._mjcf_root

    @property
    def attachment_sites(self) -> dict[str, mjcf.Element]:
        """Sites that children attach to, by face; x points out of the face."""
        return self._attachment_sites


class _RigidModule(_Module):
    """A module that is one box with attachment sites on its faces.

    Args:
        name: name of the module's MJCF model, by default its kind.
        friction: coefficient of sliding friction.
    """

    KIND: str

    def _build(self, name: str | None = None, friction: float = FRICTION) -> None:
        self._mjcf_root = _new_model(name or self.KIND)
        for box in GEOMETRY[self.KIND].boxes:
            _add_box(self._mjcf_root.worldbody, box, (0.0, 0.0, 0.0), friction)
        self._attachment_sites = {
            face_name: _add_site(self._mjcf_root.worldbody, face_name, face, (0.0, 0.0, 0.0))
            for face_name, face in GEOMETRY[self.KIND].faces.items()
        }


class Core(_RigidModule):
    """The head of a robot: a box of 0.25 kg with faces ``front``, ``left``, ``back``, ``right``.

    Its frame is at its centre.
    """

    KIND = "core"


class Brick(_RigidModule):
    """A box of 0.03 kg, attached by its back, with faces ``front``, ``left`` and ``right``."""

    KIND = "brick"


class ActiveHinge(_Module):
    """A hinge driven by a position servo, with one face, ``attachment``, at the end of its arm.

    The frame is rigid with the parent; servo and end plate turn with the arm, by at most 60
    degrees to either side. The servo's torque is ``stiffness * (target - position) - damping *
    velocity``, limited to 0.948 N·m. The motor's top speed of 6.34 rad/s is not enforced;
    ``disturbances.top_speed`` does that.

    Args:
        name: name of the module's MJCF model.
        friction: coefficient of sliding friction.
        stiffness: of the servo (N·m/rad).
        damping: of the servo (N·m·s/rad).
        armature: inertia of the motor's rotor as seen by the joint (kg·m²).
    """

    def _build(
        self,
        name: str = "hinge",
        friction: float = FRICTION,
        stiffness: float = STIFFNESS,
        damping: float = DAMPING,
        armature: float = ARMATURE,
    ) -> None:
        geometry = GEOMETRY["hinge"]
        pivot = (geometry.joint, 0.0, 0.0)
        self._mjcf_root = _new_model(name)
        for box in geometry.boxes:
            _add_box(self._mjcf_root.worldbody, box, (0.0, 0.0, 0.0), friction)
        self._arm = arm = self._mjcf_root.worldbody.add("body", name="arm", pos=pivot)
        self._joint = arm.add(
            "joint",
            name="hinge",
            type="hinge",
            axis=(0, 1, 0),
            range=(-HINGE_RANGE, HINGE_RANGE),
            limited=True,
            armature=armature,
        )
        for box in geometry.arm_boxes:
            _add_box(arm, box, pivot, friction)
        self._attachment_sites = {
            face_name: _add_site(arm, face_name, face, pivot)
            for face_name, face in geometry.faces.items()
        }
        self._actuator = self._mjcf_root.actuator.add(
            "position",
            name="servo",
            joint=self._joint,
            kp=stiffness,
            kv=damping,
            ctrllimited=True,
            ctrlrange=(-HINGE_RANGE, HINGE_RANGE),
            forcelimited=True,
            forcerange=(-HINGE_TORQUE, HINGE_TORQUE),
        )

    @property
    def arm(self) -> mjcf.Element:
        """The body that the hinge turns."""
        return self._arm

    @property
    def end_plate(self) -> mjcf.Element:
        """The geom at the end of the arm, where a child is attached."""
        return self._mjcf_root.find("geom", "end_plate")

    @property
    def joint(self) -> mjcf.Element:
        """The hinge joint; its position is 0 when the arm is straight."""
        return self._joint

    @property
    def actuator(self) -> mjcf.Element:
        """The position servo; its control is the target angle (rad)."""
        return self._actuator


def _new_model(name: str) -> mjcf.RootElement:
    model = mjcf.RootElement(model=name)
    model.compiler.angle = "radian"  # MJCF reads degrees otherwise
    return model


def _add_box(
    body: mjcf.Element,
    box: Box,
    origin: tuple[float, float, float],
    friction: float,
) -> None:
    body.add(
        "geom",
        name=box.name,
        type="box",
        pos=[centre - offset for centre, offset in zip(box.centre, origin)],
        size=[length / 2 for length in box.lengths],
        mass=box.mass,
        rgba=_COLOURS[box.name],
        friction=(friction,),
    )


def _add_site(
    body: mjcf.Element, name: str, face: Face, origin: tuple[float, float, float]
) -> mjcf.Element:
    half_angle = face.quarter_turns * math.pi / 4
    return body.add(
        "site",
        name=name,
        pos=[coordinate - offset for coordinate, offset in zip(face.position, origin)],
        quat=(math.cos(half_angle), 0.0, 0.0, math.sin(half_angle)),
        size=(0.002,),
        group=4,
    )
