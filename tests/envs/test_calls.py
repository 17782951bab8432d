"""Calls that are right, and those that are not: seeds, actions, closing."""

import copy
import re

import pytest
import torch
from torchrl.envs import Compose, TransformedEnv

from locomotion.envs import LocomotionEnv, ResumableEnv
from locomotion.transforms import HingeHistory

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("wrapped", [False, True])
def test_a_reset_with_a_seed_begins_as_one_after_set_seed(wrapped, make):
    env = make(3)
    if wrapped:
        env = TransformedEnv(env, Compose(HingeHistory(2)))
    first, second = env.reset(seed=3), env.reset(seed=3)
    assert torch.equal(first["hinge_position"], second["hinge_position"])
    assert not torch.equal(env.reset()["hinge_position"], first["hinge_position"])
    assert not torch.equal(env.reset(seed=4)["hinge_position"], first["hinge_position"])
    env.set_seed(3)
    assert torch.equal(env.reset()["hinge_position"], first["hinge_position"])


def test_a_resumed_environment_that_is_given_a_seed_begins_an_episode():
    env = ResumableEnv(LocomotionEnv("gecko", 2, seed=0), HingeHistory(2))
    start = env.reset(seed=3)
    state = env.state_dict()
    env.load_state_dict(state)
    env.reset(seed=4)
    env.load_state_dict(state)
    assert torch.equal(env.reset(seed=3)["hinge_position"], start["hinge_position"])


def test_a_reset_takes_nothing_that_it_would_ignore():
    env = LocomotionEnv("gecko", 1, seed=0)
    with pytest.raises(TypeError, match=r"reset\(\) of LocomotionEnv takes seed, not options"):
        env.reset(options={})
    with pytest.raises(TypeError):
        env.reset(seed="three")


@pytest.mark.parametrize(
    "action",
    [
        torch.zeros(3, 5),
        torch.zeros(3, 6, 1),
        torch.zeros(3, 6, dtype=torch.int64),
        torch.zeros(3, 6, dtype=torch.complex64),
    ],
    ids=lambda action: f"{action.dtype} {tuple(action.shape)}",
)
def test_an_action_of_other_numbers_or_shape_is_refused(action, make):
    env = make(3)
    td = env.reset().set("action", action.to(env.physics.device))
    before = env.physics.motion.clone()
    expected = "floating-point numbers of shape (3, 6), robots and hinges"
    got = f"got {action.dtype} of shape {tuple(action.shape)}"
    with pytest.raises(ValueError, match=f"{re.escape(expected)}.*{re.escape(got)}"):
        env.step(td)
    assert torch.equal(env.physics.motion, before)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32, torch.float64])
def test_an_action_may_have_any_precision(dtype, make):
    env = make(2)
    td = env.reset()
    action = torch.full((2, 6), 0.5, dtype=dtype, device=env.physics.device)
    assert not env.step(td.set("action", action))["next", "done"].any()
    assert (env.physics.control == 0.5).all()


def test_a_step_without_an_action_says_what_is_missing():
    env = LocomotionEnv("gecko", 3, seed=0)
    for td in (env.reset(), env.reset().set("action", "forwards")):
        with pytest.raises(KeyError, match=r"'action'.*shape \(3, 6\)"):
            env.step(td)


def test_what_it_is_can_be_read(stepping, make):
    env = make(3, "ant", readings=["hinge_position", "core_height"])
    kind = {"threaded": "BatchPhysics", "warp": "WarpPhysics"}[stepping["backend"]]
    shown = (
        "robot='ant'",
        "num_envs=3",
        f"physics={kind}(3 on {env.physics.device})",
        "readings=['hinge_position', 'core_height']",
        "rewards=['Distance']",
    )
    for text in (repr(env), repr(TransformedEnv(env, HingeHistory(2)))):
        assert all(part in text for part in shown)


USES = {
    "reset": lambda env: env.reset(),
    "step": lambda env: env.step(env.fake_tensordict()),
    "rollout": lambda env: env.rollout(1),
    "set_state": lambda env: env.set_state(torch.zeros(13), torch.zeros(12)),
    "state_dict": lambda env: env.state_dict(),
    "another field": lambda env: env.physics.field("xpos"),
    "forward": lambda env: env.physics.forward(),
    "expand": lambda env: env.physics.expand("body_mass"),
    "set_const": lambda env: env.physics.set_const(),
    "set_latency": lambda env: env.physics.set_latency(0.0),
}


@pytest.fixture(scope="module")
def closed(make):
    env = make(2)
    env.rollout(1)
    env.close()
    env.close()
    return env


@pytest.mark.parametrize("use", USES)
def test_a_closed_environment_says_so(use, closed):
    with pytest.raises(RuntimeError, match="the environment was closed"):
        USES[use](closed)
    assert "closed" in repr(closed)


def test_closing_a_copy_closes_no_other():
    env = LocomotionEnv("gecko", 2, seed=0)
    copy.deepcopy(env).close()
    env.rollout(1)
