"""Many copies stepped together against MuJoCo stepped by hand."""

import itertools

import mujoco
import pytest
import torch

from locomotion.envs import make_task
from locomotion.physics import BatchPhysics
from locomotion.robots import load_robot
from locomotion.tasks import compile_model


@pytest.mark.parametrize("threads", [1, 2, 5, None])
def test_a_batch_is_mujoco_bit_for_bit_whatever_the_threads(threads, by_hand):
    model = compile_model(make_task(load_robot("gecko")), sensors=False)
    physics = BatchPhysics(model, 7, threads)
    torch.manual_seed(0)
    controls = 3 * torch.rand(8, 7, model.nu, dtype=torch.float64) - 1.5  # beyond the limits too
    for control in controls:
        assert physics.step(control, 25) is None
    for copy in range(7):
        start = torch.as_tensor(model.qpos0), torch.zeros(model.nv)
        each = controls[:, copy].repeat_interleave(25, 0)
        qpos, qvel = by_hand(model, *start, each)
        assert torch.equal(physics.qpos[copy], qpos) and torch.equal(physics.qvel[copy], qvel)


@pytest.mark.parametrize(
    ("robot", "self_collision"), [("gecko", False), ("ant", False), ("ant", True)]
)
def test_a_control_step_is_mujocos(robot, self_collision, make, by_hand, same):
    """From states all over the gait of random actions, which also hit the joints' limits."""
    physics = make(16, robot, self_collision=self_collision)
    torch.manual_seed(0)
    # At the very start all corners of a face are on the ground, or none, by the last digit.
    physics.step(torch.rand(16, physics.model.nu).to(physics.device), 50)
    for _ in range(4):
        action = 3 * torch.rand(16, physics.model.nu, dtype=torch.float64) - 1.5
        start = physics.qpos.clone(), physics.qvel.clone()
        assert physics.step(action.to(physics.device), 25) is None
        for copy in range(16):
            each = action[copy].expand(25, -1)
            expected = by_hand(physics.model, start[0][copy], start[1][copy], each)
            same(physics, copy, expected)
        assert torch.equal(physics.previous[:, 1:], torch.cat(start, 1))


def test_fields_are_those_of_the_last_physics_step(make, fly):
    physics = make(2)
    fly(physics)
    force, control = physics.field("actuator_force"), torch.full((2, 6), 0.7)
    data = mujoco.MjData(physics.model)
    data.qpos[:], data.qvel[:] = physics.qpos[1].cpu(), physics.qvel[1].cpu()
    data.ctrl[:] = 0.7
    for _ in range(3):
        physics.step(control.to(physics.device), 1)
        mujoco.mj_step(physics.model, data)
        expected = torch.as_tensor(data.actuator_force)
        torch.testing.assert_close(force[1].cpu().double(), expected, atol=1e-6, rtol=0)
    assert physics.field("time").tolist() == pytest.approx([0.03, 0.03])


def test_a_copy_that_is_not_stepped_stays_as_it_is(make):
    """With its targets under way: in the end it is as if it had been alone."""
    physics, others = make(3, latency=0.04), make(3, latency=0.04)
    force = physics.field("actuator_force")
    torch.manual_seed(0)
    first, second, third = 2 * torch.rand(3, 3, 6, device=physics.device) - 1
    where = torch.tensor([True, False, True], device=physics.device)
    physics.step(first, 2)
    kept = physics.motion[1].clone(), physics.control[1].clone(), force[1].clone()
    physics.step(second, 10, where)
    assert all(map(torch.equal, kept, (physics.motion[1], physics.control[1], force[1])))
    physics.step(third, 20)
    for control, steps in ((first, 2), (third, 20)):
        others.step(control, steps)
    torch.testing.assert_close(physics.motion[1], others.motion[1], atol=1e-6, rtol=0)
    assert (physics.qpos[[0, 2]] - others.qpos[[0, 2]]).abs().max() > 0.01


def test_a_reset_puts_back_only_the_copies_that_it_is_told(make):
    physics = make(3, latency=0.1)
    control = torch.ones(3, 6, device=physics.device)
    physics.step(control, 20)
    kept = physics.motion[0].clone()
    physics.reset(torch.tensor([False, True, True], device=physics.device))
    assert torch.equal(physics.motion[0], kept)
    initial = torch.zeros_like(kept)
    initial[1 : 1 + physics.model.nq] = torch.as_tensor(physics.model.qpos0)
    assert torch.equal(physics.motion[1], initial) and not physics.control[1:].any()
    # The targets that were under way are gone too.
    fresh = make(3, latency=0.1)
    for both in (physics, fresh):
        both.step(0 * control, 10)
    torch.testing.assert_close(physics.motion[1:], fresh.motion[1:], atol=1e-6, rtol=0)


def test_physics_steps_one_by_one_and_many_at_a_time_come_to_the_same(make, fly):
    physics = make(4)
    torch.manual_seed(0)
    action, ends, watched = torch.rand(4, 6).to(physics.device), [], []
    for parts in ([125], [25] * 5, [1] * 125):  # 125 steps are more than one graph of Warp's has
        fly(physics)
        assert all(physics.step(action, steps) is None for steps in parts)
        ends.append(physics.qpos.clone())
    fly(physics)
    physics.step(action, 125, watch=lambda physics: watched.append(physics.qpos.clone()))
    assert len(watched) == 125
    for end in (*ends[1:], watched[-1], physics.qpos):
        torch.testing.assert_close(end, ends[0], atol=1e-5, rtol=0)


@pytest.mark.parametrize("timestep", [0.01, 0.001])
def test_whoever_watches_sees_states_before_and_after_each_physics_step(timestep, make):
    physics = make(2, timestep=timestep)
    seen = []
    physics.step(
        torch.ones(2, 6, device=physics.device),
        5,
        watch=lambda physics: seen.append((physics.previous.clone(), physics.motion.clone())),
    )
    for (_, end), (start, _) in itertools.pairwise(seen):
        assert torch.equal(end, start)
    assert torch.equal(physics.previous, seen[0][0])  # in the end, those before all of it
    assert [end[0, 0].item() for _, end in seen] == pytest.approx(
        [timestep * (1 + step) for step in range(5)]
    )


def test_a_closed_physics_can_still_be_read(make):
    physics = make(2)
    physics.step(torch.ones(2, 6, device=physics.device), 10)
    place = physics.qpos.clone()
    physics.close()
    assert torch.equal(physics.qpos, place)


def test_a_model_that_does_not_walk_is_refused():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint type='slide'/><geom size='1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(ValueError, match="a free one, then hinges"):
        BatchPhysics(model, 1)
