"""A body as data: a tree of modules, checked before anything is built from it.

The tree is what ``conf/robot/*.yaml`` spells out::

    module: core
    children:
      left: {module: hinge, children: {attachment: {module: brick}}}
      back: {module: hinge, rotation: 90}

A module is named by its path from the core, ``core/left/attachment`` for the brick above. The same
path names it in errors, in the compiled model and in the order of the actions.
"""

from __future__ import annotations

import dataclasses
import itertools
import numbers
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from locomotion.options import Checked, ConfigError, key, load_file, read_choice, typed
from locomotion.robots.geometry import GEOMETRY, Box

#: Longest chain of modules; what reads nested files gives up soon after.
MAX_NESTED = 40


class BodyError(ValueError):
    """A body that cannot exist; the message names the module by its path."""


@dataclasses.dataclass
class RobotConfig(Checked):
    """A robot: its name, and the tree of its modules, which may be drawn."""

    PREFIX = "robot."

    name: str = key("name of the robot, in run folders and in the compiled model")
    body: dict[str, Any] = key(
        "tree of modules: module, rotation (degrees), children by face; drawn if there is a seed",
        default={},
    )
    seed: int | None = key(
        "of a body that is drawn at random", default=None, least=0, most=2**31 - 1
    )
    max_hinges: int = key("most hinges of a body that is drawn", default=8, least=1, most=100)
    max_bricks: int = key("most bricks of a body that is drawn", default=8, least=0, most=100)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.seed is not None:
            self._draw(self.seed)
        if not self.body:
            raise ConfigError("robot.body is missing")
        if not self.name or "/" in self.name or not self.name.isprintable():
            self.refuse("name", repr(self.name), "a name of printable characters without '/'")
        try:
            parse_body(self.body)
        except BodyError as error:
            raise ConfigError(f"robot {self.name}: {error}") from error

    def _draw(self, seed: int) -> None:
        from locomotion.robots.random_body import random_body

        drawn = random_body(seed, self.max_hinges, self.max_bricks)
        if not self.body:
            self.name, self.body = f"{self.name}{seed}", drawn
        elif self.body != drawn:
            self.refuse("seed", seed, "null for a body that is not drawn; robot=random draws one")


def load_robot(robot: str | Path | RobotConfig | Mapping[str, Any]) -> RobotConfig:
    """A robot by its name in ``conf/robot``, the path of a YAML file, or a mapping.

    Raises:
        ConfigError: for an unknown robot, or a body that cannot exist.
    """
    if isinstance(robot, RobotConfig):
        return robot
    if isinstance(robot, Mapping):
        return typed(RobotConfig, dict(robot))
    if isinstance(robot, Path) or robot.endswith((".yaml", ".yml")):
        loaded = load_file(Path(robot), RobotConfig, name=Path(robot).stem)
        refuse_sexagesimal(Path(robot))
        return loaded
    return typed(RobotConfig, read_choice("robot", robot))


def refuse_sexagesimal(path: Path) -> None:
    """Raises a :class:`ConfigError` for a number such as ``1:30`` in a YAML file, which is read as 90."""
    for event in yaml.parse(path.read_text(encoding="utf-8")):
        plain = isinstance(event, yaml.ScalarEvent) and event.style is None
        if plain and re.fullmatch(r"[-+]?[1-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?", event.value):
            line = event.start_mark.line + 1
            raise ConfigError(f"{path}, line {line}: {event.value} is a number in base 60 to YAML")


@dataclasses.dataclass(frozen=True)
class Module:
    """One module of a body, with everything attached to it.

    Attributes:
        kind: ``"core"``, ``"brick"`` or ``"hinge"``.
        path: its place in the tree, such as ``"core/back/attachment"``.
        quarter_turns: how often it is turned by 90 degrees about the axis that it is attached
            along, counter-clockwise for someone who looks back at the parent; 0 to 3.
        children: by the face that carries them, in the order front, left, back, right.
    """

    kind: str
    path: str
    quarter_turns: int
    children: dict[str, Module]

    def walk(self) -> Iterator[Module]:
        """This module and all below it, parents first."""
        yield self
        for child in self.children.values():
            yield from child.walk()


def parse_body(tree: Mapping[str, Any]) -> Module:
    """Reads a body tree and makes sure that it can be built.

    Args:
        tree: nested mappings with the keys ``module`` (``core``, ``brick`` or ``hinge``),
            ``rotation`` (degrees, a multiple of 90; 0 if absent) and ``children`` (face to tree).

    Returns:
        The core, with the rest of the body below it.

    Raises:
        BodyError: for an unknown module or key, a face that the module lacks or that is used
            twice, an angle that is not a quarter turn, a root that is not a core, a core elsewhere, a
            body without hinges, two modules in one place, or too long a chain of modules.
    """
    core = _parse_module(tree, "core")
    if core.kind != "core":
        raise BodyError(f"core: a body starts from a core, not from a {core.kind}")
    if not any(module.kind == "hinge" for module in core.walk()):
        raise BodyError("core: the body has no hinge, so it cannot move")
    _check_overlap(core)
    return core


def placed_modules(core: Module) -> Iterator[tuple[Module, np.ndarray, np.ndarray]]:
    """Yields every module of a body with all hinges at 0, as ``(module, origin, rotation)``.

    The origin (m, shape ``(3,)``) is where its frame is in the core's, the rotation (shape ``(3, 3)``) has
    the axes of its frame as columns; quarter turns keep them parallel to the core's.
    """
    pending = [(core, np.zeros(3), np.eye(3))]
    while pending:
        module, origin, rotation = pending.pop()
        yield module, origin, rotation
        faces = GEOMETRY[module.kind].faces
        for name, child in module.children.items():
            turned = rotation @ _about_z(faces[name].quarter_turns) @ _about_x(child.quarter_turns)
            pending.append((child, origin + rotation @ faces[name].position, turned))


def placed_boxes(core: Module) -> Iterator[tuple[Module, Box, np.ndarray, np.ndarray]]:
    """Yields every box of a body with all hinges at 0, as ``(module, box, centre, lengths)``.

    Centre and lengths (m, shape ``(3,)``) are in the core's frame. Quarter turns keep all boxes
    parallel to its axes.
    """
    for module, origin, rotation in placed_modules(core):
        geometry = GEOMETRY[module.kind]
        for box in geometry.boxes + geometry.arm_boxes:
            yield module, box, origin + rotation @ box.centre, np.abs(rotation @ box.lengths)


def _parse_module(tree: Any, path: str) -> Module:
    if not isinstance(tree, Mapping):
        raise BodyError(f"{path}: expected a module such as {{module: brick}}, got {tree!r}")
    for name in tree:
        if name not in ("module", "rotation", "children"):
            raise BodyError(f"{path}: unknown key {name!r}; allowed are module, rotation, children")
    kind = tree.get("module")
    if kind not in GEOMETRY:
        raise BodyError(f"{path}: unknown module {kind!r}; choose from {', '.join(GEOMETRY)}")
    if path.count("/") >= MAX_NESTED:
        raise BodyError(f"{path}: more than {MAX_NESTED} modules one after another")
    if kind == "core" and path != "core":
        raise BodyError(f"{path}: a body has one core, at its root")
    return Module(
        kind=kind,
        path=path,
        quarter_turns=_parse_rotation(tree.get("rotation", 0), path),
        children=_parse_children(tree.get("children"), kind, path),
    )


def _parse_rotation(rotation: Any, path: str) -> int:
    is_number = isinstance(rotation, numbers.Real) and not isinstance(rotation, (bool, np.bool_))
    if not is_number or rotation % 90 != 0:
        raise BodyError(
            f"{path}: rotation {rotation!r} is not a quarter turn; use 0, 90, 180 or 270"
        )
    return int(rotation // 90) % 4


def _parse_children(children: Any, kind: str, path: str) -> dict[str, Module]:
    if children is None:
        return {}
    if not isinstance(children, Mapping):
        raise BodyError(f"{path}: children must map faces to modules, got {children!r}")
    faces = GEOMETRY[kind].faces
    for face in children:
        if face not in faces:
            raise BodyError(f"{path}: a {kind} has no face {face!r}; it has {', '.join(faces)}")
    # In the faces' own order, so that the order of the hinges does not hang on the spelling.
    return {
        face: _parse_module(children[face], f"{path}/{face}") for face in faces if face in children
    }


def _check_overlap(core: Module) -> None:
    # Neighbours touch, and lengths carry rounding errors, so a shared sliver is not an overlap.
    tolerance = 1e-4
    boxes = list(placed_boxes(core))
    for (a, _, a_centre, a_lengths), (b, _, b_centre, b_lengths) in itertools.combinations(
        boxes, 2
    ):
        if a is b:
            continue
        gap = np.abs(a_centre - b_centre) - (a_lengths + b_lengths) / 2
        if np.all(gap < -tolerance):
            first, second = sorted((a.path, b.path), key=lambda path: (path.count("/"), path))
            raise BodyError(f"{second}: stands in the same place as {first}")


def _about_z(quarter_turns: int) -> np.ndarray:
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarter_turns]
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], dtype=float)


def _about_x(quarter_turns: int) -> np.ndarray:
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarter_turns]
    return np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]], dtype=float)
