"""OpenGL to draw with, chosen by what works on this machine."""

from __future__ import annotations

import importlib
import os
import sys
import warnings
from typing import Any

from locomotion.options import ConfigError

ADVICE = "drawing needs OpenGL; on Debian and Ubuntu: apt install libegl1 libgl1-mesa-dri"
#: What MuJoCo has contexts for; those that need no screen come first.
_BACKENDS = {"linux": ("egl", "osmesa", "glfw"), "darwin": ("cgl", "glfw")}


def open_context(width: int, height: int) -> Any:
    """Opens an OpenGL context for pictures of a size, and makes it current.

    ``MUJOCO_GL`` is tried first, if it names a backend, then the others of MuJoCo's. It does not matter
    which one MuJoCo chose when it was imported.

    Returns:
        The context, whose ``free()`` closes it.

    Raises:
        ConfigError: if there is nothing to draw with.
    """
    wish = os.environ.get("MUJOCO_GL", "").strip().lower()
    names = _BACKENDS.get(sys.platform, ("glfw",))
    reasons = []
    for name in sorted(names, key=lambda name: name != wish):
        try:
            return _open(name, width, height)
        except Exception as error:  # noqa: BLE001  each backend raises its own
            reasons.append(f"{name}: {' '.join(str(error).split())}")
    raise ConfigError(f"{ADVICE} ({'; '.join(reasons)})")


def _open(name: str, width: int, height: int) -> Any:
    if name == "glfw" and not has_screen():
        raise RuntimeError("there is no screen")
    before = os.environ.get("PYOPENGL_PLATFORM")
    if name in ("egl", "osmesa"):
        os.environ["PYOPENGL_PLATFORM"] = name
    try:
        context = importlib.import_module(f"mujoco.{name}").GLContext(width, height)
        context.make_current()
    except BaseException:
        forget_opengl()
        if before is not None:
            os.environ["PYOPENGL_PLATFORM"] = before
        raise
    return context


def forget_opengl() -> None:
    """Lets OpenGL be imported anew, as PyOpenGL chooses its platform when it is."""
    os.environ.pop("PYOPENGL_PLATFORM", None)
    for name in list(sys.modules):
        if name.startswith(("OpenGL", "mujoco.egl", "mujoco.osmesa", "dm_control._render")):
            del sys.modules[name]


def has_graphics() -> bool:
    """Whether there is something to draw with."""
    try:
        open_context(1, 1).free()
    except ConfigError:
        return False
    return True


def has_screen() -> bool:
    """Whether a window can be opened."""
    if sys.platform != "linux":
        return True
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return False
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import glfw

            return bool(glfw.init())  # what is set may be of a screen that is gone
    except ImportError:
        return False
