"""Simulations that go numerically wrong: caught where it happens, and never seen by the learner."""

import contextlib
import math

import pytest
import torch
from torchrl.collectors import Collector

from locomotion.envs import LocomotionEnv
from locomotion.options import readings

pytestmark = pytest.mark.slow

NAN, INF = math.nan, math.inf
#: Entry of the state (position or velocity, index) and the value it is given.
BAD = {
    "position is nan": ("qpos", 8, NAN),
    "position is infinite": ("qpos", 0, -INF),
    "velocity is nan": ("qvel", 3, NAN),
    "velocity is huge": ("qvel", 7, 1e12),
    "finite, but blows up": ("qvel", 4, 900.0),
    "faster than any robot": ("qvel", 1, 100.0),
    "ten metres in the air": ("qpos", 2, 11.0),
}


def spoil(env, robot, bad):
    name, index, value = BAD[bad]
    getattr(env.physics, name)[robot, index] = value


@pytest.fixture(scope="module")
def flock(make):
    """Robots for tests that leave nothing behind but their state."""
    return make(4, readings=readings.names())


@pytest.mark.parametrize("bad", BAD)
def test_a_bad_state_ends_the_episode_of_its_robot_alone(bad, flock):
    td = flock.reset()
    state = flock.physics.state_dict()
    action = torch.rand(4, 6, device=flock.physics.device)
    expected = flock.step(td.clone().set("action", action))["next"]
    flock.physics.load_state_dict(state)
    spoil(flock, 2, bad)
    td = flock.step(td.set("action", action))["next"]
    others = [0, 1, 3]
    torch.testing.assert_close(td[others].to_dict(), expected[others].to_dict())
    assert td["terminated"].squeeze(-1).tolist() == [False, False, True, False]
    assert torch.equal(td["done"], td["terminated"]) and not td["truncated"].any()
    assert td["reward"][2] == 0
    assert all(value.isfinite().all() for value in td.values())

    (divergence,) = flock.take_divergences()
    assert divergence.robot == 2 and divergence.qpos.device.type == "cpu"
    assert torch.equal(divergence.action, action[2].cpu())
    assert flock.take_divergences() == []

    fresh = flock.reset(td.set("_reset", td["done"]))
    assert fresh["core_position"][2, :2].norm() < 0.3
    assert not flock.step(fresh.set("action", action))["next", "done"].any()


def test_an_action_that_is_not_finite_ends_the_episode_of_its_robot_alone(flock):
    td = flock.reset()
    action = torch.rand(4, 6, device=flock.physics.device)
    action[1, 3] = NAN
    td = flock.step(td.set("action", action))["next"]
    assert td["terminated"].squeeze(-1).tolist() == [False, True, False, False]
    assert all(value.isfinite().all() for value in td.values())
    (divergence,) = flock.take_divergences()
    assert divergence.robot == 1 and divergence.action[3].isnan()


@pytest.mark.parametrize(("value", "num_envs"), [(NAN, 1), (INF, 4), (-INF, 1)])
def test_so_it_does_in_a_first_step_alone_and_after_a_partial_reset(value, num_envs, make):
    env = make(num_envs)
    env.reset()
    one = torch.arange(num_envs, device=env.physics.device) == num_envs - 1
    for _ in range(2):
        td = env.fake_tensordict()
        action = torch.zeros_like(td["action"])
        action[one, 2] = value
        td = env.step(td.set("action", action))["next"]
        assert torch.equal(td["terminated"].squeeze(-1), one)
        assert not td["reward"][one].any() and td["reward"].isfinite().all()
        env.reset(td.set("_reset", td["done"]))
        assert env.physics.motion.isfinite().all() and env.physics.control.isfinite().all()
    assert [each.robot for each in env.take_divergences()] == 2 * [num_envs - 1]


@pytest.mark.parametrize("watched", [False, True])
def test_a_state_that_nothing_can_start_from_is_what_led_to_a_divergence(watched, make):
    """And not the initial state, from which the same action would lead nowhere bad."""
    env = make(2)
    td = env.reset()
    spoil(env, 1, "position is nan")
    before = env.physics.motion[1].cpu().clone()
    with env.after_substep(lambda physics: None) if watched else contextlib.nullcontext():
        env.step(td.set("action", torch.zeros_like(env.action_spec.zero())))
    (divergence,) = env.take_divergences()
    found = torch.cat([divergence.qpos, divergence.qvel])
    torch.testing.assert_close(found, before[1:], atol=0, rtol=0, equal_nan=True)
    assert env.physics.motion.isfinite().all()


@pytest.mark.parametrize("watched", [False, True])
def test_what_led_to_a_divergence_can_be_replayed(watched, make):
    """From the state before the control step, in whatever part of it things went wrong."""
    env = make(4)
    td = env.reset()
    spoil(env, 1, "finite, but blows up")
    before = env.physics.motion[1].cpu().clone()
    td.set("action", torch.rand(4, 6, device=env.physics.device))
    with env.after_substep(lambda physics: None) if watched else contextlib.nullcontext():
        env.step(td)
    (divergence,) = env.take_divergences()
    assert torch.equal(torch.cat([divergence.qpos, divergence.qvel]), before[1:])
    replay = make(1)
    td = replay.reset()
    replay.set_state(divergence.qpos, divergence.qvel)
    action = divergence.action[None].to(replay.physics.device)
    assert replay.step(td.set("action", action))["next", "terminated"].all()
    (again,) = replay.take_divergences()
    assert torch.equal(again.qpos, divergence.qpos) and torch.equal(again.qvel, divergence.qvel)


def test_physics_that_cannot_hold_pays_nothing_absurd():
    """A timestep far too long for stiff servos without damping."""
    stiff = {"stiffness": 1000.0, "damping": 0.0, "armature": 0.0, "timestep": 0.05}
    env = LocomotionEnv("gecko", 16, seed=0, physics=stiff)
    rollout = env.rollout(20, break_when_any_done=False)
    assert rollout["next", "terminated"].any()
    assert rollout["next", "reward"].abs().max() < 20 / 4  # what the fastest robot would walk


def test_settling_that_diverges_leaves_the_robot_at_rest(make):
    """Servos that send a robot through the roof as soon as a target is not 0."""
    env = make(2)
    for name in ("actuator_gainprm", "actuator_forcerange"):
        env.physics.expand(name)[0] *= 1e9
    td = env.reset()
    assert not td["done"].any()
    assert all(value.isfinite().all() for value in td.values())
    assert not td["hinge_position"][0].any() and td["hinge_position"][1].all()
    assert [divergence.robot for divergence in env.take_divergences()] == [0]


class Unlucky(LocomotionEnv):
    """Robots whose states are spoiled in given control steps."""

    def __init__(self, when, **keywords):
        super().__init__("gecko", 4, seed=0, **keywords)
        self.when, self.count = when, 0

    def _step(self, tensordict):
        for robot, bad in self.when.get(self.count, {}).items():
            spoil(self, robot, bad)
        self.count += 1
        return super()._step(tensordict)


@pytest.mark.parametrize("time_limit", [None, 1.0])
def test_a_collector_sees_a_terminated_step_and_a_fresh_start(time_limit):
    def collect(when):
        """A batch in which robots diverge, by control step."""
        env = Unlucky(when, time_limit=time_limit)
        torch.manual_seed(0)
        collector = Collector(env, None, frames_per_batch=40, total_frames=40)
        batch = next(iter(collector)).clone()
        return batch, env.take_divergences()

    when = {2: {1: "velocity is nan"}, 3: {1: "finite, but blows up", 3: "position is nan"}}
    batch, divergences = collect(when)
    untouched, none = collect({})
    assert none == [] and [divergence.robot for divergence in divergences] == [1, 1, 3]
    terminated = torch.zeros(4, 10, dtype=torch.bool)
    for step, robots in when.items():
        terminated[list(robots), step] = True
    assert torch.equal(batch["next", "terminated"].squeeze(-1), terminated)
    assert (batch["next", "reward"].squeeze(-1)[terminated] == 0).all()
    for value in batch.flatten_keys().values():
        assert value.double().isfinite().all()
    # Nothing happened to the others, but for the draws at others' resets.
    robots = torch.tensor([0, 2])
    steps = 4 if time_limit else 10
    assert (batch[robots][:, :steps] == untouched[robots][:, :steps]).all()
