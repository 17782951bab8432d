"""Environment variables that would keep what draws nothing from running."""

from __future__ import annotations

import importlib.util
import os
import warnings


def tidy() -> None:
    """Removes what MuJoCo, dm-control or matplotlib cannot be imported with.

    They look at import for what they would draw with. A film finds that by itself
    (:mod:`locomotion.rendering.graphics`), figures need no window, and nothing else is drawn.

    - ``MUJOCO_GL`` of an OpenGL that is not there, as on a cluster's nodes without one;
    - ``MPLBACKEND`` of a package that is not there, as a notebook sets it for commands that run in
      another Python.
    """
    # dm-control tries to open a window at import; a machine without a screen is no reason to warn.
    for message in ("The DISPLAY environment", "X11: Failed to open", "Wayland: Failed to connect"):
        warnings.filterwarnings("ignore", message=f".*{message}")
    if os.environ.get("MUJOCO_GL"):
        _require_opengl()
    backend = os.environ.get("MPLBACKEND", "")
    package = backend.removeprefix("module://").split(".")[0]
    if backend.startswith("module://") and not (package and importlib.util.find_spec(package)):
        del os.environ["MPLBACKEND"]


def _require_opengl() -> None:
    try:
        import dm_control._render  # noqa: F401  without MuJoCo, and asking for more than it does
    except Exception:  # noqa: BLE001  each backend raises its own
        from locomotion.rendering.graphics import forget_opengl

        del os.environ["MUJOCO_GL"]
        forget_opengl()
