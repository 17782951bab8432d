"""OpenGL is found by trying it, and is missed by films alone."""

import sys
from ctypes.util import find_library

import pytest

from locomotion.rendering.graphics import has_screen

pytestmark = pytest.mark.slow

FILM = ("seconds=0.25", "fps=4", "width=64", "height=64", "output=gait.gif")
NOTEBOOK = "module://no_such_package.backend_inline"
on_linux = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a screen")
#: An OpenGL that cannot be used: no machine has that number of GPUs.
NO_EGL = {"MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": "99"}


@on_linux
@pytest.mark.usefixtures("drawing")
def test_a_film_is_drawn_with_what_works_whatever_is_set(run, tmp_path):
    stale = {"DISPLAY": "localhost:97", "WAYLAND_DISPLAY": "gone"}
    wrong = {"MUJOCO_GL": "osmesa", "PYOPENGL_PLATFORM": "osmesa", "MPLBACKEND": NOTEBOOK}
    for variables in (stale, wrong):
        result = run("watch", *FILM, cwd=tmp_path, **variables)
        assert result.returncode == 0, result.stderr
        assert result.stderr == ""
        (tmp_path / "gait.gif").unlink()


@on_linux
@pytest.mark.usefixtures("drawing")
@pytest.mark.parametrize(
    "variables",
    [
        {"DISPLAY": "localhost:97", "MUJOCO_GL": "glfw"},
        {"MUJOCO_GL": "nonsense"},
    ],
    ids=str,
)
def test_a_script_can_draw_after_it_imported_mujoco(variables, python, tmp_path):
    code = """
import locomotion, mujoco
from dm_control import composer
from locomotion.envs import LocomotionEnv
from locomotion.evaluation import PolicyRunner
from locomotion.rendering import record_motion
from locomotion.rendering.film import draw

env = LocomotionEnv("gecko", 1)
motion = record_motion(PolicyRunner(env, env.rand_action), seconds=0.25, fps=4)
(picture,) = draw(motion, 64, 48)
assert picture.shape == (48, 64, 3)
assert picture.std() > 10
"""
    result = python(code, cwd=tmp_path, **variables)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    "variables",
    [{}, NO_EGL, {"MUJOCO_GL": "nonsense"}],
    ids=str,
)
def test_what_it_needs_can_be_imported_in_silence(variables, python, tmp_path):
    code = "import locomotion; from dm_control import composer; import mujoco, locomotion.plots"
    result = python(code, cwd=tmp_path, MPLBACKEND=NOTEBOOK, **variables)
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


def test_what_draws_nothing_needs_nothing_to_draw_with(run, tmp_path):
    small = ("env.num_envs=2", "ppo.steps=2", "ppo.minibatch_size=2", "ppo.iterations=1")
    calls = [
        ("train", *small, "hydra.run.dir=run"),
        ("plot", "run"),
        ("evaluate", "run=run", "env.num_envs=2", "seconds=0.5"),
        ("export", "run=run", "output=gait.pt2"),
        ("watch", "run=run", "web=true", "seconds=0.5"),
    ]
    for name, *arguments in calls:
        result = run(name, *arguments, cwd=tmp_path, MPLBACKEND=NOTEBOOK, **NO_EGL)
        assert result.returncode == 0, (name, result.stderr)
        assert result.stderr == "", name
    assert (tmp_path / "run" / "learning_curve.png").is_file()


@on_linux
def test_a_film_without_opengl_is_refused_before_anything_is_computed(run, tmp_path):
    if find_library("OSMesa"):
        pytest.skip("there is another OpenGL")
    result = run("watch", *FILM, cwd=tmp_path, **NO_EGL)
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert "apt install libegl1 libgl1-mesa-dri" in result.stderr
    assert "MUJOCO_EGL_DEVICE_ID" in result.stderr  # why, in MuJoCo's words
    assert not list(tmp_path.iterdir())


@on_linux
@pytest.mark.parametrize("variables", [{}, {"WAYLAND_DISPLAY": "gone"}], ids=str)
def test_the_viewer_needs_a_screen_that_is_there(variables, run, tmp_path):
    result = run("watch", "live=true", cwd=tmp_path, **variables)
    assert result.returncode == 2
    assert result.stderr == "error: live=true needs a screen; a film or web=true does not\n"


@on_linux
def test_a_screen_that_is_gone_is_none(monkeypatch):
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", "localhost:97")
    assert not has_screen()
