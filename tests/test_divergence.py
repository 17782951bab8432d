"""Simulations that go numerically wrong: caught where it happens, and never seen by the learner."""

import pytest
import torch

from locomotion.assembly import make_env, make_policy
from locomotion.command_line.composing import compose
from locomotion.envs import LocomotionEnv
from locomotion.train import make_collector

NAN, INF = float("nan"), float("inf")
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
    getattr(env._physics, name)[robot, index] = value


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("threads", [1, 2])
def test_a_bad_state_ends_the_episode_of_its_robot_alone(bad, threads):
    env, untouched = (
        LocomotionEnv("gecko", 5, seed=0, physics={"threads": threads}) for _ in range(2)
    )
    td, expected = env.reset(), untouched.reset()
    action = torch.rand(5, 6)
    spoil(env, 2, bad)
    td = env.step(td.set("action", action))["next"]
    expected = untouched.step(expected.set("action", action))["next"]
    others = torch.tensor([0, 1, 3, 4])
    assert (td[others] == expected[others]).all()
    assert td["terminated"].squeeze(-1).tolist() == [False, False, True, False, False]
    assert torch.equal(td["done"], td["terminated"]) and not td["truncated"].any()
    assert td["reward"][2] == 0
    assert all(value.isfinite().all() for value in td.values())

    (divergence,) = env.take_divergences()
    assert divergence.robot == 2
    assert torch.equal(divergence.action, action[2])
    assert env.take_divergences() == []

    fresh = env.reset(td.set("_reset", td["done"]))
    assert fresh["core_position"][2, :2].norm() < 0.3
    after = env.step(fresh.set("action", action))["next"]
    assert not after["done"].any()


def test_what_led_to_a_divergence_can_be_replayed():
    env = LocomotionEnv("gecko", 4, seed=0)
    td = env.reset()
    spoil(env, 1, "finite, but blows up")
    env.step(td.set("action", torch.rand(4, 6)))
    (divergence,) = env.take_divergences()
    replay = LocomotionEnv("gecko", 1)
    td = replay.reset()
    replay.set_state(divergence.qpos, divergence.qvel)
    td = replay.step(td.set("action", divergence.action[None]))["next"]
    assert td["terminated"].all()
    (again,) = replay.take_divergences()
    assert torch.equal(again.qpos, divergence.qpos) and torch.equal(again.qvel, divergence.qvel)


def test_a_long_control_step_is_watched_in_all_its_parts():
    env = LocomotionEnv("gecko", 2, seed=0, control_frequency=0.05)  # 2,000 physics steps
    td = env.reset()
    spoil(env, 1, "finite, but blows up")
    td = env.step(td.set("action", torch.rand(2, 6)))["next"]
    assert td["terminated"].squeeze(-1).tolist() == [False, True]
    assert [divergence.robot for divergence in env.take_divergences()] == [1]


def test_physics_that_cannot_hold_pays_nothing_absurd():
    """A timestep far too long for stiff servos without damping."""
    stiff = {"stiffness": 1000.0, "damping": 0.0, "armature": 0.0, "timestep": 0.05}
    env = LocomotionEnv("gecko", 16, seed=0, physics=stiff)
    rollout = env.rollout(20, break_when_any_done=False)
    assert rollout["next", "terminated"].any()
    assert rollout["next", "reward"].abs().max() < 20 / 4  # what the fastest robot would walk


def test_settling_that_diverges_leaves_the_robot_at_rest():
    env = LocomotionEnv("gecko", 2, seed=0)
    step = env._physics.step

    def spoiled(control, num_steps, where=None):
        spoil(env, 0, "velocity is huge")
        return step(control, num_steps, where)

    env._physics.step = spoiled
    td = env.reset()
    assert not td["done"].any()
    assert all(value.isfinite().all() for value in td.values())
    assert [divergence.robot for divergence in env.take_divergences()] == [0]


@pytest.mark.parametrize("time_limit", ["null", "1"])
def test_the_learner_sees_a_terminated_step_and_a_fresh_start(time_limit):
    config = compose(
        *("+obs=history3", "env.num_envs=4", "ppo.steps=10", "ppo.minibatch_size=40"),
        f"env.time_limit={time_limit}",
    )

    def collect(when):
        """A batch in which robots diverge, by control step."""
        torch.manual_seed(0)
        env = make_env(config)
        robots = env.base_env
        actor = make_policy(config, env)
        collector = make_collector(config, env, actor)
        advance, count = robots.advance, iter(range(10))

        def spoiling(action, place):
            for robot, bad in when.get(next(count), {}).items():
                spoil(robots, robot, bad)
            return advance(action, place)

        robots.advance = spoiling
        return next(iter(collector)), robots.take_divergences()

    when = {2: {1: "velocity is nan"}, 3: {1: "finite, but blows up", 3: "position is nan"}}
    batch, divergences = collect(when)
    untouched, none = collect({})
    assert none == [] and [d.robot for d in divergences] == [1, 1, 3]
    terminated = torch.zeros(4, 10, dtype=torch.bool)
    for step, robots in when.items():
        terminated[list(robots), step] = True
    assert torch.equal(batch["next", "terminated"].squeeze(-1), terminated)
    assert (batch["next", "reward"].squeeze(-1)[terminated] == 0).all()
    for value in batch.flatten_keys().values():
        assert value.isfinite().all()
    robots = torch.tensor([0, 2])  # nothing happened to them, but for the draws at others' resets
    first = batch[robots][:, :4] if time_limit == "1" else batch[robots]
    assert (first == untouched[robots][:, : first.shape[1]]).all()
    history = batch["hinge_position_history"][1, 3]
    assert not history[6:].any() and history[:6].all()
