"""Tasks: dm-control tasks, the rewards they add up, and the model they compile to.

Everything here works on :class:`~locomotion.tasks.state.RobotState`, so a reward is written once for
dm-control's environment and for the batched one.
"""

from importlib import import_module
from typing import Any

_NAMES = {
    "RobotState": "locomotion.tasks.state",
    "WalkAway": "locomotion.tasks.walk_away",
    "compile_model": "locomotion.tasks.model",
}

__all__ = list(_NAMES)


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(_NAMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
