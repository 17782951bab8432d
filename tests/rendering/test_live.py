"""A gait in MuJoCo's viewer, whose window is stood in for."""

import contextlib
import time

import mujoco.viewer
import numpy as np
import pytest

from locomotion.envs import LocomotionEnv
from locomotion.evaluation import PolicyRunner
from locomotion.options import ConfigError
from locomotion.rendering import show_live


class Window(contextlib.AbstractContextManager):
    """A viewer without a window, which is closed after a number of pictures."""

    def __init__(self, pictures=10_000):
        self.cam, self.shown, self.left = mujoco.MjvCamera(), [], pictures

    def __call__(self, model, data, **options):
        self.data = data
        return self

    def __exit__(self, *_):
        pass

    def sync(self):
        self.left -= 1
        self.shown.append(self.data.qpos.copy())

    def is_running(self):
        return self.left > 0


@pytest.fixture
def runner():
    env = LocomotionEnv("gecko", 2, physics={"threads": 1})
    return PolicyRunner(env, env.rand_action)


def test_each_physics_step_is_shown_at_the_pace_of_the_clock(runner, monkeypatch):
    window = Window()
    monkeypatch.setattr(mujoco.viewer, "launch_passive", window)
    began = time.perf_counter()
    show_live(runner, seconds=0.75)
    assert time.perf_counter() - began > 0.7
    assert len(window.shown) == 75
    np.testing.assert_array_equal(window.shown[-1], runner.base_env.physics.qpos[0])
    assert window.data.time == pytest.approx(0.75)


def test_it_ends_when_the_window_is_closed(runner, monkeypatch):
    window = Window(pictures=30)
    monkeypatch.setattr(mujoco.viewer, "launch_passive", window)
    show_live(runner, seconds=60)
    assert len(window.shown) == 50  # to the end of the control step


def test_a_viewer_that_does_not_open_is_said_in_mujocos_words(runner, monkeypatch):
    def refuse(*arguments, **options):
        raise RuntimeError(
            "`launch_passive` requires that\nthe Python script be run under mjpython"
        )

    monkeypatch.setattr(mujoco.viewer, "launch_passive", refuse)
    with pytest.raises(ConfigError, match="live=true: `launch_passive` requires that the Python"):
        show_live(runner, seconds=1)
