"""The task for TorchRL: many robots stepped together, and the readings that they can sense."""

from importlib import import_module
from typing import Any

_NAMES = {
    "Divergence": "locomotion.envs.divergence",
    "LocomotionEnv": "locomotion.envs.environment",
    "ResumableEnv": "locomotion.envs.resumable",
    "make_task": "locomotion.envs.making",
}

__all__ = list(_NAMES)


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(_NAMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
