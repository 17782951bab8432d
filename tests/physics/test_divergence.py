"""Copies that go numerically wrong: put back, one by one, with all that they were."""

import math

import pytest
import torch

OTHERS = [0, 1, 3]


def drawn(physics, steps=1):
    torch.manual_seed(0)
    return (2 * torch.rand(steps, physics.num_envs, 6, dtype=torch.float64) - 1).to(physics.device)


@pytest.mark.parametrize(
    ("value", "watched"), [(math.nan, False), (-math.inf, False), (math.nan, True)]
)
def test_a_control_that_is_not_finite_is_a_divergence_of_its_robot_alone(value, watched, make):
    """Also with targets under way, which arrive later as if nothing had happened."""
    physics, sound = make(4, latency=0.04), make(4, latency=0.04)
    first, second, third = drawn(physics, 3)
    watch = (lambda physics: None) if watched else None
    for both in (physics, sound):
        assert both.step(first, 10) is None
    before = physics.motion.clone()
    wrong = second.clone()
    wrong[2, 4] = value
    assert physics.step(wrong, 25, watch=watch).tolist() == [False, False, True, False]
    assert torch.equal(physics.motion[2], before[2])
    assert physics.control.isfinite().all()
    moving = torch.tensor([True, True, False, True], device=physics.device)
    sound.step(second, 25, moving, watch)
    for both in (physics, sound):
        assert both.step(third, 25) is None
    torch.testing.assert_close(physics.motion, sound.motion, atol=1e-6, rtol=0)


def test_copies_that_are_not_stepped_cannot_diverge(make):
    physics = make(4)
    control = drawn(physics)[0]
    control[1] = math.nan
    where = torch.tensor([True, False, True, True], device=physics.device)
    assert physics.step(control, 5, where) is None
    assert physics.step(control, 5).tolist() == [False, True, False, False]


def test_whoever_watches_never_sees_what_is_not_finite(make):
    physics = make(4)
    force, start = physics.field("actuator_force"), physics.motion.clone()
    seen, control = [], drawn(physics)[0]
    physics.qvel[2, 4] = 900.0  # finite, but it blows up after some steps

    def watch(physics):
        seen.append(physics.motion[OTHERS].clone())
        assert physics.motion.isfinite().all() and force.isfinite().all()

    diverged = physics.step(control, 25, watch=watch)
    assert diverged.tolist() == [False, False, True, False]
    assert physics.qvel[2, 4] == 900.0 and physics.motion[2, 0] == 0.0
    assert len(seen) == 25
    physics.motion.copy_(start)
    physics.step(control, 25, torch.tensor([True, True, False, True], device=physics.device))
    torch.testing.assert_close(seen[-1], physics.motion[OTHERS], atol=1e-5, rtol=0)


def test_a_state_that_nothing_can_start_from_becomes_the_initial_one(make):
    physics = make(4, latency=0.04)
    force, control = physics.field("actuator_force"), drawn(physics)[0]
    physics.step(control, 10)
    physics.qpos[2, 1] = math.nan
    assert physics.step(control, 10).tolist() == [False, False, True, False]
    initial = torch.zeros_like(physics.motion[2])
    initial[1 : 1 + physics.model.nq] = torch.as_tensor(physics.model.qpos0)
    assert torch.equal(physics.motion[2], initial)
    assert not force[2].any()  # nor is a target under way
    # What it left in the memory of the simulation does not come back.
    for _ in range(3):
        assert physics.step(control, 10) is None


def test_a_long_control_step_is_watched_in_all_its_parts(make):
    physics = make(4)
    physics.qvel[1, 4] = 900.0
    diverged = physics.step(drawn(physics)[0], 2500)
    assert diverged.tolist() == [False, True, False, False]


@pytest.mark.parametrize("time", [0.0, 0.1])
@pytest.mark.parametrize(
    ("field", "index", "value"), [("qvel", 7, 1e12), ("qvel", 1, 100.0), ("qpos", 2, 11.0)]
)
def test_a_state_that_no_robot_comes_to_is_a_divergence_at_any_time(
    field, index, value, time, make
):
    physics = make(4)
    control = drawn(physics)[0]
    physics.motion[:, 0] = time
    getattr(physics, field)[2, index] = value
    assert physics.step(control, 25).tolist() == [False, False, True, False]
    assert physics.motion.abs().max() < 1e3
