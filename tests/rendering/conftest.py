import os
import subprocess
import sys

import numpy as np
import pytest

from locomotion.rendering.graphics import has_graphics

#: What says which screen and which OpenGL there are.
_GRAPHICS = ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM", "MUJOCO_EGL_DEVICE_ID")


@pytest.fixture(scope="session")
def run(command):
    """Runs a command of the project without a screen, but for what ``variables`` say."""
    bare = dict.fromkeys(_GRAPHICS)
    return lambda *line, cwd, **variables: command(*line, cwd=cwd, **{**bare, **variables})


@pytest.fixture(scope="session")
def python():
    """Runs Python code likewise."""

    def run(code, cwd, **variables):
        kept = {name: value for name, value in os.environ.items() if name not in _GRAPHICS}
        line, keywords = [sys.executable, "-c", code], {"capture_output": True, "text": True}
        return subprocess.run(line, cwd=cwd, env={**kept, **variables}, timeout=300, **keywords)

    return run


@pytest.fixture(scope="session")
def drawing():
    """Skips tests on a machine that has nothing to draw with."""
    if not has_graphics():
        pytest.skip("no OpenGL; apt install libegl1 libgl1-mesa-dri")


@pytest.fixture(scope="session")
def is_like():
    """Counts the pixels of a picture that have a colour, roughly."""

    def count(pixels, colour, tolerance=50):
        return (np.abs(pixels.astype(int) - colour).max(-1) < tolerance).sum()

    return count
