"""Robots from and into files: Revolve2's trees in, a YAML of this project out."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from locomotion.options import ConfigError
from locomotion.robots.body import BodyError, Module, RobotConfig, parse_body
from locomotion.writing import atomic_write

if TYPE_CHECKING:
    from locomotion.robots.modular_robot import ModularRobot


def as_tree(body: Module) -> dict[str, Any]:
    """A body as the tree that :func:`~locomotion.robots.parse_body` reads."""
    tree: dict[str, Any] = {"module": body.kind}
    if body.quarter_turns:
        tree["rotation"] = 90 * body.quarter_turns
    if body.children:
        tree["children"] = {face: as_tree(child) for face, child in body.children.items()}
    return tree


def read_revolve2(path: Path | str) -> RobotConfig:
    """A robot from a JSON tree in Revolve2's words; its name is that of the file.

    Each module is ``{"module": ..., "quarter_turns": ..., "children": {face: module}}``; the file holds the
    core, or has it under ``"core"``.

    Raises:
        ConfigError: for a file that is missing or no JSON, or a body that cannot exist.
    """
    path = Path(path)
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path} is not JSON: {' '.join(str(error).split())}") from error
    core = found.get("core", found) if isinstance(found, dict) else found
    try:
        return RobotConfig(name=path.stem, body=as_tree(parse_body(_translated(core, "core"))))
    except BodyError as error:
        raise ConfigError(f"{path}: {error}") from error


def _translated(tree: Any, place: str) -> Any:
    if not isinstance(tree, Mapping):
        return tree  # which the parser refuses by its place
    own = {name: value for name, value in tree.items() if name != "quarter_turns"}
    turns = tree.get("quarter_turns", 0)
    if not isinstance(turns, int):
        raise BodyError(f"{place}: quarter_turns {turns!r} is not a whole number")
    own["rotation"] = 90 * turns
    children = tree.get("children")
    if isinstance(children, Mapping):
        own["children"] = {f: _translated(child, f"{place}/{f}") for f, child in children.items()}
    return own


def save_robot(robot: RobotConfig | ModularRobot | Module, path: Path | str) -> None:
    """Writes a robot as a YAML file that ``robot=FILE.yaml`` and ``LocomotionEnv("FILE.yaml")`` take.

    Args:
        robot: a configuration, an entity, or the core of a body.
        path: the file; its stem is the name of the robot.

    Raises:
        OSError: if the file cannot be written.
    """
    path = Path(path)
    if isinstance(robot, RobotConfig):
        body = parse_body(robot.body)
    else:
        body = robot if isinstance(robot, Module) else robot.body
    content = {"name": path.stem, "body": as_tree(body)}
    with atomic_write(path) as partial:
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
        partial.write_text(text, encoding="utf-8")
