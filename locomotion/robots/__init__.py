"""Robots: modules, and bodies put together from them, as dm-control composer entities.

The entities are loaded when they are first asked for, as dm-control takes a second.
"""

from importlib import import_module
from typing import Any

from locomotion.robots.body import (
    BodyError,
    Module,
    RobotConfig,
    load_robot,
    parse_body,
    refuse_sexagesimal,
)
from locomotion.robots.files import as_tree, read_revolve2, save_robot
from locomotion.robots.random_body import random_body
from locomotion.robots.symmetry import Mirror, mirrors

_ENTITIES = {
    "ActiveHinge": "locomotion.robots.modules",
    "Brick": "locomotion.robots.modules",
    "Core": "locomotion.robots.modules",
    "ModularRobot": "locomotion.robots.modular_robot",
}

__all__ = [
    "ActiveHinge",
    "BodyError",
    "Brick",
    "Core",
    "Mirror",
    "ModularRobot",
    "Module",
    "RobotConfig",
    "as_tree",
    "load_robot",
    "mirrors",
    "parse_body",
    "random_body",
    "read_revolve2",
    "refuse_sexagesimal",
    "save_robot",
]


def __getattr__(name: str) -> Any:
    if name in _ENTITIES:
        return getattr(import_module(_ENTITIES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
