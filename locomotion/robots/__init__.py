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
    "ModularRobot",
    "Module",
    "RobotConfig",
    "load_robot",
    "parse_body",
    "refuse_sexagesimal",
]


def __getattr__(name: str) -> Any:
    if name in _ENTITIES:
        return getattr(import_module(_ENTITIES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
