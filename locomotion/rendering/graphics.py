"""Which OpenGL MuJoCo draws with; chosen before MuJoCo is imported."""

from __future__ import annotations

import ctypes.util
import os
import sys

#: What MuJoCo can draw with where there is no screen, and the library that each needs.
_OFFSCREEN = {"egl": "EGL", "osmesa": "OSMesa"}
ADVICE = "drawing without a screen needs OpenGL; on Debian and Ubuntu: apt install libegl1 libgl1-mesa-dri"


def has_screen() -> bool:
    """Whether a window could be opened."""
    if sys.platform != "linux":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def choose_graphics() -> None:
    """Sets ``MUJOCO_GL``, unless it is set or there is a screen, to what this machine can draw with."""
    if not has_graphics():
        for name, library in _OFFSCREEN.items():
            if ctypes.util.find_library(library):
                os.environ["MUJOCO_GL"] = name
                try:
                    import dm_control._render  # noqa: F401
                except Exception:  # noqa: BLE001  the library is there and does not work
                    for variable in ("MUJOCO_GL", "PYOPENGL_PLATFORM"):
                        os.environ.pop(variable, None)
                return


def has_graphics() -> bool:
    """Whether there is something to draw with, as far as can be told without trying."""
    return bool(os.environ.get("MUJOCO_GL")) or has_screen()
