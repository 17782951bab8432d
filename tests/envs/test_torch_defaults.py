"""Torch's default dtype and default device, which somebody else's code may have set."""

import numpy as np
import pytest
import torch
from dm_control import composer
from torchrl.envs import Compose, TransformedEnv, check_env_specs

from locomotion.envs import LocomotionEnv
from locomotion.envs.observations import make_transforms, typed_terms
from locomotion.options import readings
from locomotion.transforms import IncludeOrientation, SensorNoise

pytestmark = pytest.mark.slow


def both(make, block):
    expected = make()
    with block:
        found = make()
    return expected, found


def equal(expected, found):
    expected, found = expected.flatten_keys(), found.flatten_keys()
    assert set(expected.keys()) == set(found.keys())
    for key, value in expected.items():
        torch.testing.assert_close(found[key], value, atol=0, rtol=0, msg=key)


def test_an_environment_is_the_same(others_defaults, make):
    def walk():
        env = make(3, readings=readings.names(), time_limit=1.0, disturbances={"latency": 0.1})
        env.physics.set_latency(0.05)
        check_env_specs(env)
        torch.manual_seed(0)
        return env.rollout(6, break_when_any_done=False).cpu()

    equal(*both(walk, others_defaults))


def test_starts_without_a_seed_are_those_of_torchs(others_defaults):
    def start():
        torch.manual_seed(0)
        return LocomotionEnv("gecko", 3).reset()

    equal(*both(start, others_defaults))


def test_what_the_policy_sees_is_the_same(others_defaults):
    terms = {
        "hinge_position": {"steps": 3, "scale": 0.5},
        "tilt": {"reading": "core_orientation", "representation": "gravity"},
        "core_position": {"scale": 0.1},
    }

    def walk():
        written = make_transforms(typed_terms(terms))[0]
        more = [IncludeOrientation("rotation_6d"), SensorNoise(0.1, ["hinge_position"])]
        base = LocomotionEnv("gecko", 3, seed=0)
        env = TransformedEnv(base, Compose(*written, *more))
        check_env_specs(env)
        torch.manual_seed(0)
        return env.rollout(4)

    equal(*both(walk, others_defaults))


def test_dm_controls_environment_is_the_same(others_defaults):
    def walk():
        task = LocomotionEnv("gecko", 1, seed=0, readings=readings.names()).task
        env = composer.Environment(task, random_state=0)
        env.reset()
        step = env.step(np.full(6, 0.5))
        return step.reward, step.observation

    (reward, seen), (other_reward, other_seen) = both(walk, others_defaults)
    assert reward == other_reward
    for name, value in seen.items():
        np.testing.assert_array_equal(value, other_seen[name])
