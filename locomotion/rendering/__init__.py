"""Showing a gait: a film, a page for the browser, MuJoCo's viewer.

Any policy in any environment around a :class:`~locomotion.envs.LocomotionEnv` can be filmed:

>>> from locomotion.evaluation import PolicyRunner
>>> from locomotion.rendering import record_motion, write_film
>>> write_film(record_motion(PolicyRunner(env, policy), seconds=8), "gait.mp4")

The policy reads what the environment writes, and writes ``action``; the first robot is filmed.
:func:`~locomotion.rendering.page.write_page` makes a page for the browser instead, and
:func:`~locomotion.rendering.live.show_live` shows a runner in MuJoCo's viewer.
"""

from importlib import import_module
from typing import Any

_NAMES = {
    "Motion": "motion",
    "record_motion": "motion",
    "show_live": "live",
    "write_film": "film",
    "write_page": "page",
}

__all__ = list(_NAMES)


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(f"locomotion.rendering.{_NAMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
