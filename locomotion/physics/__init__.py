"""Physics: many copies of one compiled model, stepped together."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_NAMES = {
    "BatchPhysics": "locomotion.physics.batch",
    "Physics": "locomotion.physics.base",
    "make_physics": "locomotion.physics.making",
}

__all__ = list(_NAMES)


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(_NAMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
