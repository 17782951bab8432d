"""A whole robot: modules attached to one another as a body tree says."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

from dm_control import composer, mjcf

from locomotion.robots.body import Module, parse_body, placed_boxes
from locomotion.robots.geometry import ARMATURE, DAMPING, FRICTION, STIFFNESS
from locomotion.robots.modules import ActiveHinge, Brick, Core

_RIGID = {"core": Core, "brick": Brick}


class ModularRobot(composer.Entity):
    """A robot assembled from a body tree.

    Elements of the compiled model are named by their module's path: the joint of the hinge
    ``core/left`` of the robot ``gecko`` is ``gecko/core/left/hinge`` and its servo
    ``gecko/core/left/servo``. Bodies that do not move against their parent are fused by the
    compiler; the core ends up in the body that carries the free joint, ``gecko/``.

    Args:
        body: a body tree as :func:`~locomotion.robots.parse_body` reads it, or what it returns.
        name: name of the robot's MJCF model.
        friction: coefficient of sliding friction of all modules.
        stiffness: of the hinges' servos (N·m/rad).
        damping: of the hinges' servos (N·m·s/rad).
        armature: inertia of the motors' rotors as seen by the joints (kg·m²).
        self_collision: whether the robot's limbs collide with one another. Parts on both sides of a
            hinge never do; robots always collide with other robots.

    Raises:
        BodyError: if the body cannot exist.
    """

    def _build(
        self,
        body: Module | Mapping[str, Any],
        name: str = "robot",
        friction: float = FRICTION,
        stiffness: float = STIFFNESS,
        damping: float = DAMPING,
        armature: float = ARMATURE,
        self_collision: bool = False,
    ) -> None:
        self._body = body if isinstance(body, Module) else parse_body(body)
        self._material = {"friction": friction}
        self._servo = {"stiffness": stiffness, "damping": damping, "armature": armature}
        self._hinges: dict[str, ActiveHinge] = {}
        self._mjcf_root = mjcf.RootElement(model=name)
        self._mjcf_root.compiler.fusestatic = True
        self._core = Core(name="core", **self._material)
        self.attach(self._core, self._mjcf_root.worldbody.add("site", name="origin", group=4))
        self._modules: dict[str, composer.Entity] = {self._body.path: self._core}
        self._attach_children(self._core, self._body)
        self._self_collision = self_collision
        if not self_collision:
            self._exclude_own_contacts()

    def _exclude_own_contacts(self) -> None:
        # All other bodies are rigid with one of these, and share its exclusions once fused.
        moving = [mjcf.get_attachment_frame(self._core.mjcf_model)]
        moving += [hinge.arm for hinge in self._hinges.values()]
        for one, other in itertools.combinations(moving, 2):
            self._mjcf_root.contact.add("exclude", body1=one, body2=other)

    def _attach_children(self, parent: composer.Entity, module: Module) -> None:
        for face, child in module.children.items():
            if child.kind == "hinge":
                entity = ActiveHinge(name=face, **self._material, **self._servo)
                self._hinges[child.path] = entity
            else:
                entity = _RIGID[child.kind](name=face, **self._material)
            self._modules[child.path] = entity
            frame = parent.attach(entity, parent.attachment_sites[face])
            half_angle = child.quarter_turns * math.pi / 4
            # The frame takes the site's pose; the child is turned about its own x axis on top.
            w, z = parent.attachment_sites[face].quat[0], parent.attachment_sites[face].quat[3]
            cos, sin = math.cos(half_angle), math.sin(half_angle)
            frame.quat = (w * cos, w * sin, z * sin, z * cos)
            self._attach_children(entity, child)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        return self._mjcf_root

    @property
    def body(self) -> Module:
        """The tree that the robot was built from."""
        return self._body

    @property
    def core(self) -> Core:
        """The module at the root of the tree."""
        return self._core

    @property
    def modules(self) -> dict[str, composer.Entity]:
        """All modules by their path, parents first."""
        return self._modules

    @property
    def self_collision(self) -> bool:
        """Whether the robot's limbs collide with one another."""
        return self._self_collision

    @property
    def hinges(self) -> dict[str, ActiveHinge]:
        """Hinges by their path, in the order of actions and of hinge observations."""
        return self._hinges

    @composer.cached_property
    def hinge_joints(self) -> tuple[mjcf.Element, ...]:
        """The hinges' joints, in the order of :attr:`hinges`."""
        return tuple(hinge.joint for hinge in self._hinges.values())

    @composer.cached_property
    def actuators(self) -> tuple[mjcf.Element, ...]:
        """The hinges' servos, in the order of :attr:`hinges`."""
        return tuple(hinge.actuator for hinge in self._hinges.values())

    @composer.cached_property
    def covered_geoms(self) -> frozenset[mjcf.Element]:
        """End plates behind a brick, which is wider and higher.

        They reach the ground only where the brick has already sunk into it.
        """
        return frozenset(
            self._hinges[module.path].end_plate
            for module in self._body.walk()
            if module.kind == "hinge" and module.children.get("attachment", module).kind == "brick"
        )

    @composer.cached_property
    def standing_height(self) -> float:
        """Height of the core's centre (m) when the robot stands with all hinges at 0."""
        return max(lengths[2] / 2 - centre[2] for _, _, centre, lengths in placed_boxes(self._body))

    @composer.cached_property
    def reach(self) -> float:
        """The maximum distance (m) from the core to a part of the robot along the ground, with all hinges at 0."""
        return max(
            math.hypot(*(abs(centre[:2]) + lengths[:2] / 2))
            for _, _, centre, lengths in placed_boxes(self._body)
        )

    @composer.cached_property
    def overturned_height(self) -> float:
        """Height of the core's centre (m) when the robot lies upside down with all hinges at 0."""
        return max(lengths[2] / 2 + centre[2] for _, _, centre, lengths in placed_boxes(self._body))
