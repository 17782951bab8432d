"""Noise is Gaussian, new in every step, and leaves alone what it is not told to disturb."""

import pytest
import torch
from torchrl.envs import (
    Compose,
    GymEnv,
    RenameTransform,
    StepCounter,
    TransformedEnv,
    check_env_specs,
)

from locomotion.transforms import SensorNoise


def noisy(env, deviation=0.5):
    """Keeps what is true as ``truth``."""
    keep = RenameTransform(["angle"], ["truth"], create_copy=True)
    return TransformedEnv(env, Compose(keep, SensorNoise(deviation, "angle")))


def test_it_has_its_deviation_and_is_independent(counting_env):
    torch.manual_seed(0)
    rollout = noisy(counting_env([1000] * 50)).rollout(100)
    noise = (rollout["angle"] - rollout["truth"]) / 0.5
    assert noise.numel() == 10_000
    assert noise.mean().abs() < 0.04  # four standard errors
    assert abs(noise.std() - 1) < 0.03
    assert abs(noise.pow(4).mean() - 3) < 0.4
    for one, other in ((noise[:, 1:], noise[:, :-1]), (noise[1:], noise[:-1])):
        assert (one * other).mean().abs() < 0.04
    # A policy sees what is stored as what follows, not another sample.
    assert torch.equal(rollout["angle"][:, 1:], rollout["next", "angle"][:, :-1])


def test_robots_that_go_on_while_others_are_reset_keep_their_sample(counting_env):
    rollout = noisy(counting_env([2, 3, 50])).rollout(12, break_when_any_done=False)
    goes_on = ~rollout["next", "done"][:, :-1, 0]
    assert torch.equal(rollout["angle"][:, 1:][goes_on], rollout["next", "angle"][:, :-1][goes_on])
    starts = rollout["angle"][:, 1:][~goes_on]
    assert ((starts - rollout["truth"][:, 1:][~goes_on]).abs() > 1e-6).all()
    assert torch.equal(
        rollout["speed"], (rollout["truth"].mean(-1, keepdim=True) * torch.arange(1, 4))
    )


def test_without_a_deviation_nothing_changes(counting_env):
    rollout = noisy(counting_env([5, 6]), 0.0).rollout(4)
    assert torch.equal(rollout["angle"], rollout["truth"])


def test_specs_allow_for_noise_beyond_the_bounds_of_an_entry():
    torch.manual_seed(0)
    check_env_specs(TransformedEnv(GymEnv("Pendulum-v1"), SensorNoise(50.0, "observation")))


@pytest.mark.parametrize("deviation", [-0.1, float("nan"), float("inf"), "0.1", None])
def test_a_wrong_deviation_is_named(deviation):
    with pytest.raises(ValueError, match="deviation must be a number of at least 0"):
        SensorNoise(deviation)


def test_an_entry_that_is_not_of_floating_point_numbers_is_named():
    with pytest.raises(ValueError, match="'step_count' holds torch.int64, not floating point"):
        TransformedEnv(
            GymEnv("Pendulum-v1"), Compose(StepCounter(), SensorNoise(0.1, "step_count"))
        )
