"""Targets that arrive late, against MuJoCo whose control is switched by hand at the right time."""

import math

import pytest
import torch

from locomotion.options import ConfigError

#: Physics steps in a control step, and their length (s).
SUBSTEPS, TIMESTEP = 25, 0.01


def late(targets, latency):
    """The target in each physics step, for targets that are given one a control step.

    Before the first one arrives, that of a model at rest is held: 0.
    """
    given = targets.repeat_interleave(SUBSTEPS, 0)
    steps = math.ceil(latency / TIMESTEP - 1e-9)
    return torch.cat([torch.zeros(steps, targets.shape[1]), given])[: len(given)]


def drawn(num_steps, copies):
    generator = torch.Generator().manual_seed(1)
    return 2 * torch.rand(num_steps, copies, 6, generator=generator, dtype=torch.float64) - 1


def walk(physics, targets):
    start = physics.qpos.clone(), physics.qvel.clone()
    for target in targets:
        assert physics.step(target.to(physics.device), SUBSTEPS) is None
    return start


@pytest.mark.parametrize("latency", [0.0, 0.004, 0.013, 0.07, 0.25, 0.61])
def test_one_latency_for_all(latency, make, fly, by_hand, same):
    physics = make(2, latency=latency)
    fly(physics)
    targets = drawn(4, 2)
    qpos, qvel = walk(physics, targets)
    for copy in range(2):
        expected = by_hand(make(1).model, qpos[copy], qvel[copy], late(targets[:, copy], latency))
        same(physics, copy, expected)


#: Time after two hours as the clock has it, which adds timesteps up.
TWO_HOURS = sum(TIMESTEP for _ in range(720_000))


@pytest.mark.parametrize("time", [0.0, TWO_HOURS])
def test_a_latency_for_each_copy_however_late_it_is(time, make, fly, by_hand, same):
    latencies = [0.0, 0.01, 0.05, 0.123, 0.25, 0.29, 0.7]
    physics = make(7, latency=0.7)
    fly(physics)
    physics.motion[:, 0] = time
    physics.set_latency(torch.tensor(latencies))
    targets = drawn(4, 7)
    qpos, qvel = walk(physics, targets)
    for copy, latency in enumerate(latencies):
        expected = by_hand(make(1).model, qpos[copy], qvel[copy], late(targets[:, copy], latency))
        same(physics, copy, expected)


def test_the_targets_of_hours_arrive_as_late_as_the_first(make, fly, by_hand, same):
    """Those of half an hour on the ground, then those of a second in the air."""
    physics = make(1, latency=0.3, timestep=0.05)
    physics.step(torch.zeros(1, 6, device=physics.device), 36_000)
    fly(physics)
    targets = drawn(4, 1)
    qpos, qvel = physics.qpos.clone(), physics.qvel.clone()
    for target in targets:
        physics.step(target.to(physics.device), 5)
    given = torch.cat([torch.zeros(6, 6), targets[:, 0].repeat_interleave(5, 0)])[:20]
    same(physics, 0, by_hand(make(1, timestep=0.05).model, qpos[0], qvel[0], given))


@pytest.mark.parametrize("latency", [0.21, -0.01, math.nan, [0.1, 0.3]])
def test_a_latency_that_cannot_be_is_refused(latency, make):
    physics = make(2, latency=0.2)
    with pytest.raises(ConfigError, match="a latency of"):
        physics.set_latency(torch.tensor(latency))


def test_there_is_no_room_unless_it_was_asked_for(make):
    physics = make(2)
    physics.set_latency(0.0)
    with pytest.raises(
        ConfigError, match=r"0\.1 s is beyond the 0 s .* disturbances\.latency makes room"
    ):
        physics.set_latency(0.1)
