"""Evaluation of policies: walking, measuring, and the changes that a real robot would bring."""

from importlib import import_module
from typing import Any

_MODULES = {
    "controller": ("Controller",),
    "measures": ("MEASURES", "Interval", "measure", "speed", "summarise"),
    "policy": ("load_policy", "require_parts"),
    "robustness": ("PERTURBATIONS", "Perturbation", "Robustness", "check_robustness", "perturbed"),
    "walking": ("PolicyRunner", "Trajectory", "make_runner", "walk"),
}
_NAMES = {name: module for module, names in _MODULES.items() for name in names}

__all__ = list(_NAMES)


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(f"locomotion.evaluation.{_NAMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
