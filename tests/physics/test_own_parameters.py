"""Copies with model parameters of their own, against models that were compiled with them."""

import pytest
import torch

#: The compiler rounds centres of mass, which are not given here.
ROUNDING = 1e-10
HEAVY, STRONG = (0.8, 1.0, 1.5), (0.5, 1.0, 1.3)


def targets(copies):
    generator = torch.Generator().manual_seed(2)
    return 2 * torch.rand(3, copies, 6, generator=generator, dtype=torch.float64) - 1


def stepped_like(models, physics, by_hand, same):
    qpos, qvel = physics.qpos.clone(), physics.qvel.clone()
    drawn = targets(len(models))
    for target in drawn:
        assert physics.step(target.to(physics.device), 25) is None
    for copy, model in enumerate(models):
        each = drawn[:, copy].repeat_interleave(25, 0)
        same(physics, copy, by_hand(model, qpos[copy], qvel[copy], each), ROUNDING)
    assert (physics.qpos[0] - physics.qpos[2]).abs().max() > 1e-3


def give(physics, models, *names):
    """Gives each copy those fields of its own model."""
    for name in names:
        values = [torch.as_tensor(getattr(model, name)) for model in models]
        own = physics.expand(name)
        own.copy_(torch.stack(values).reshape(own.shape))


def test_masses(make, fly, by_hand, same):
    models = [make(1, mass=scale).model for scale in HEAVY]
    physics = make(3)
    give(physics, models, "body_mass", "body_inertia")
    physics.set_const()
    fly(physics)
    physics.qvel[:] = physics.qvel[:1]
    stepped_like(models, physics, by_hand, same)


def test_the_constants_that_follow_from_masses_are_those_of_contacts_too(make, by_hand, same):
    """On the ground, where the softness of contacts depends on them."""
    models = [make(1, mass=scale).model for scale in HEAVY]
    physics = make(3)
    give(physics, models, "body_mass", "body_inertia")
    physics.set_const()
    physics.step(targets(3)[0].to(physics.device), 60)
    qpos, qvel = physics.qpos.clone(), physics.qvel.clone()
    control = targets(3)[1]
    physics.step(control.to(physics.device), 25)
    for copy, model in enumerate(models):
        each = control[copy].expand(25, -1)
        same(physics, copy, by_hand(model, qpos[copy], qvel[copy], each), ROUNDING)


def test_strengths(make, fly, by_hand, same):
    models = [make(1, strength=scale).model for scale in STRONG]
    physics = make(3)
    fly(physics)
    physics.qvel[:] = physics.qvel[:1]
    give(physics, models, "actuator_gainprm", "actuator_biasprm", "actuator_forcerange")
    stepped_like(models, physics, by_hand, same)


def test_parameters_may_change_between_steps(make, fly, by_hand, same):
    weak = make(1, strength=0.5).model
    physics = make(3)
    fly(physics)
    control = targets(3)[0]
    physics.step(control.to(physics.device), 10)  # with what a graph of Warp's was captured for
    give(physics, [physics.model, physics.model, weak], "actuator_gainprm", "actuator_biasprm")
    qpos, qvel = physics.qpos.clone(), physics.qvel.clone()
    physics.step(control.to(physics.device), 10)
    for copy, model in ((1, physics.model), (2, weak)):
        each = control[copy].expand(10, -1)
        same(physics, copy, by_hand(model, qpos[copy], qvel[copy], each))


def test_what_is_expanded_holds_the_models_values(make):
    physics = make(3)
    for name in ("body_mass", "actuator_gainprm", "actuator_forcerange", "dof_armature"):
        own, shared = physics.expand(name), torch.as_tensor(getattr(physics.model, name))
        assert own is physics.expand(name)
        torch.testing.assert_close(own.cpu().double(), shared.expand(3, *shared.shape))


@pytest.mark.parametrize("reset", [False, True])
def test_a_reset_leaves_parameters_alone(reset, make):
    physics = make(2)
    physics.expand("body_mass")[1] *= 2
    physics.set_const()
    before = physics.expand("body_mass").clone()
    if reset:
        physics.reset(torch.tensor([False, True], device=physics.device))
    physics.step(torch.zeros(2, 6, device=physics.device), 5)
    assert torch.equal(physics.expand("body_mass"), before)


def test_a_reset_begins_at_the_initial_positions_of_each_copy(make):
    physics = make(3)
    physics.expand("qpos0")[1, 2] += 1.0
    for where in (None, torch.tensor([False, True, True], device=physics.device)):
        physics.step(torch.zeros(3, 6, device=physics.device), 5)
        physics.reset(where)
        expected = torch.as_tensor(physics.model.qpos0).expand(3, -1).clone()
        expected[1, 2] += 1.0
        rows = slice(None) if where is None else where.cpu()
        off = physics.qpos.cpu()[rows] - expected[rows]
        assert off.abs().max() < 1e-6


def test_a_parameter_is_read_as_each_copy_has_it(make):
    physics = make(2)
    shared = torch.as_tensor(physics.model.body_mass)
    assert torch.equal(physics.parameter("body_mass").cpu(), shared[None])
    assert physics.parameter("body_mass") is not physics.parameter("dof_armature")
    own = physics.expand("body_mass")
    own[1] *= 2
    read = physics.parameter("body_mass").cpu().double()
    torch.testing.assert_close(read, torch.stack([shared, 2 * shared]), rtol=1e-6, atol=0)
