"""The state of a physics: with it another one resumes as if nothing had happened."""

import pytest
import torch


@pytest.fixture
def alike(stepping):
    """Compares tensors bit for bit; on a GPU, where the order of additions varies, to some digits."""

    def alike(one, other):
        if stepping.get("device", "cpu") == "cpu":
            assert torch.equal(one, other)
        else:
            torch.testing.assert_close(one, other, atol=1e-4, rtol=0)

    return alike


def disturb(physics):
    """Gives copies latencies, masses and strengths of their own."""
    physics.set_latency(torch.tensor([0.0, 0.07, 0.3]))
    physics.expand("body_mass")[2] *= 1.5
    physics.set_const()
    physics.expand("actuator_gainprm")[1] *= 0.5


@pytest.mark.parametrize("disturbed", [False, True])
def test_it_resumes_bit_for_bit(disturbed, make, alike):
    torch.manual_seed(0)
    targets = 2 * torch.rand(4, 3, 6) - 1
    first, second = make(3, latency=0.3), make(3, latency=0.3)
    targets = targets.to(first.device)
    if disturbed:
        disturb(first)
    for target in targets[:2]:
        first.step(target, 25)
    state = first.state_dict()
    for target in targets[2:]:
        first.step(target, 25)
    second.step(targets[0], 40)  # whatever it was before
    second.expand("dof_armature").mul_(3)
    second.load_state_dict(state)
    alike(second.control, targets[1].to(second.control))
    for target in targets[2:]:
        second.step(target, 25)
    alike(second.motion, first.motion)
    assert torch.equal(second.expand("body_mass"), first.expand("body_mass"))


def test_a_state_is_a_copy_that_can_be_read_anywhere(make, tmp_path):
    physics = make(2, latency=0.1)
    disturbed = physics.expand("actuator_gainprm")
    physics.step(torch.ones(2, 6, device=physics.device), 10)
    torch.save(physics.state_dict(), tmp_path / "state.pt")
    place = physics.motion.clone()
    state = physics.state_dict()
    disturbed *= 2
    physics.step(torch.ones(2, 6, device=physics.device), 10)
    for saved in (state, torch.load(tmp_path / "state.pt", map_location="cpu", weights_only=True)):
        physics.load_state_dict(saved)
        assert torch.equal(physics.motion, place)
        gains = torch.as_tensor(physics.model.actuator_gainprm)
        torch.testing.assert_close(disturbed[0].cpu().double(), gains)


def test_derived_fields_are_of_the_state_that_was_loaded(make):
    physics = make(2)
    force = physics.field("actuator_force")
    state = physics.state_dict()
    physics.step(torch.ones(2, 6, device=physics.device), 10)
    assert force.abs().max() > 0.1
    physics.load_state_dict(state)
    assert not force.any()
