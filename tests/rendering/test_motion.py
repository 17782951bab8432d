"""The motion that a film is made from: which moments, and the speed that is said of it."""

import math

import numpy as np
import pytest
import torch

from locomotion.envs import LocomotionEnv
from locomotion.evaluation import PolicyRunner, measure, walk
from locomotion.rendering import record_motion


@pytest.fixture
def env():
    return LocomotionEnv("gecko", 2, seed=0)


def swinging(env):
    """A policy of a sine."""
    steps = []

    def policy(tensordict):
        steps.append(1)
        action = torch.sin(len(steps) + torch.arange(6)).expand(env.action_spec.shape)
        return tensordict.set("action", action)

    return policy


@pytest.mark.parametrize("fps", [25, 10, 7])
def test_pictures_are_the_moments_of_the_first_robot(fps, env):
    motion = record_motion(PolicyRunner(env, swinging(env)), seconds=3, fps=fps)
    assert len(motion.qpos) == 3 * fps
    again = LocomotionEnv("gecko", 2, seed=0)
    runner, moments = PolicyRunner(again, swinging(again)), []
    runner.start()
    moments.append(again.physics.qpos[0].clone())
    with again.after_substep(lambda physics: moments.append(physics.qpos[0].clone())):
        for _ in range(12):
            runner.step(sampled=False)
    for picture, qpos in enumerate(motion.qpos):
        moment = int(picture * 100 / fps + 1e-9)  # of the physics' 100 a second
        np.testing.assert_array_equal(qpos, moments[moment])
        assert motion.control_step[picture] == moment // 25


def test_there_is_no_picture_between_two_physics_steps(env):
    motion = record_motion(PolicyRunner(env, swinging(env)), seconds=0.5, fps=1000)
    assert (motion.fps, len(motion.qpos)) == (100, 50)


def circling(env):
    """Puts the cores on a circle of 1 m radius, once around in 8 s; hinges hold still."""
    steps = []

    def policy(tensordict):
        steps.append(1)
        angle = 2 * math.pi * len(steps) / 32
        env.physics.qpos[:, 0], env.physics.qpos[:, 1] = math.sin(angle), 1 - math.cos(angle)
        return tensordict.set("action", torch.zeros(env.action_spec.shape))

    return policy


def test_its_speed_is_evaluates_over_the_same_time_also_in_a_circle(env):
    motions = {s: record_motion(PolicyRunner(env, circling(env)), seconds=s) for s in (4, 8)}
    for seconds, motion in motions.items():
        again = LocomotionEnv("gecko", 2, seed=0)
        if seconds == 8:
            PolicyRunner(again, circling(again)).start()  # the second episode of the environment
        found = measure(walk(PolicyRunner(again, circling(again)), seconds))
        assert motion.seconds == seconds
        assert motion.distance == found["distance"][0].item()
        assert motion.speed == pytest.approx(found["speed"][0].item())
    # Across the circle, and back at its start: a film of another length has another speed.
    assert motions[4].speed == pytest.approx(2 / 4, rel=0.05)
    assert motions[8].speed == pytest.approx(0, abs=0.05)
    # On the pictures it is the one so far.
    assert motions[8].speed_at(100) == pytest.approx(2 / 4, rel=0.1)
    assert motions[8].speed_at(199) == pytest.approx(0, abs=0.05)


def test_a_simulation_that_diverged_has_no_speed(env):
    def policy(tensordict):
        return tensordict.set("action", torch.full(env.action_spec.shape, math.nan))

    assert math.isnan(record_motion(PolicyRunner(env, policy), seconds=1).speed)
