"""Each reward against a closed form, and the same in dm-control's environment as in the batched one."""

import dataclasses
import math

import numpy as np
import pytest
import torch
from dm_control import composer

from locomotion.envs import LocomotionEnv, make_task
from locomotion.options import ConfigError, rewards
from locomotion.robots import ModularRobot, load_robot
from locomotion.tasks import RobotState, WalkAway
from locomotion.tasks.options import TaskConfig
from locomotion.tasks.rewards import Distance, Heading, Reward, Velocity, Work

GECKO = load_robot("gecko")


def task(*paid, **settings):
    return WalkAway(ModularRobot(GECKO.body, "gecko"), rewards=paid, **settings)


def state(of, places, yaws=None, work=None, start=(0.0, 0.0)):
    """Robots at places, turned about the vertical axis, and tilted by a right angle on top."""
    yaws = torch.zeros(len(places)) if yaws is None else torch.tensor(yaws)
    qpos = torch.zeros(len(places), 13, dtype=torch.float64)
    qpos[:, :2] = torch.tensor(places)
    qpos[:, 3], qpos[:, 6] = (yaws / 2).cos(), (yaws / 2).sin()
    starts = torch.tensor(start, dtype=torch.float64).expand(len(places), 2)
    return RobotState(of, None, {"qpos": qpos}.__getitem__, starts, work)


def test_distance_is_what_is_gained_from_the_start():
    of = task()
    before = state(of, [(1.0, 1.0), (4.0, 5.0), (1.0, 1.0)], start=(1.0, 1.0))
    after = state(of, [(4.0, 5.0), (1.0, 1.0), (1.0, -1.0)], start=(1.0, 1.0))
    assert Distance()(before, after).tolist() == pytest.approx([5, -5, 2])


@pytest.mark.parametrize("period", [0.25, 1.0])
def test_velocity_is_the_mean_along_a_direction(period):
    of = task(control_timestep=period)
    places = [(0.3, 0.0), (0.0, 0.3), (-0.2, -0.2)]
    before, after = state(of, [(7.0, 7.0)] * 3), state(of, [(7 + x, 7 + y) for x, y in places])
    for direction in (0.0, math.pi / 2, 2.0, -3.0):
        expected = [
            math.hypot(x, y) / period * math.cos(math.atan2(y, x) - direction) for x, y in places
        ]
        assert Velocity(direction=direction)(before, after).tolist() == pytest.approx(expected)


@pytest.mark.parametrize(
    ("heading", "before", "after", "paid"),
    [
        (0.0, 1.0, 0.4, 0.6),
        (0.0, -0.4, -1.0, -0.6),
        (0.0, 0.3, -0.3, 0.0),
        (1.0, 0.0, 2.5, -0.5),
        (math.pi, 3.0, -3.0, 0.0),  # past the heading, where angles jump
        (math.pi, -3.0, -3.1, 0.1),
        (0.0, math.pi, 0.0, math.pi),
    ],
)
def test_heading_pays_for_the_angle_turned_towards_it(heading, before, after, paid):
    of = task()
    states = (state(of, [(0.0, 0.0)], [yaw]) for yaw in (before, after))
    assert Heading(heading=heading)(*states).item() == pytest.approx(paid, abs=1e-6)


def test_a_heading_is_the_direction_of_the_cores_front_on_the_ground():
    """However the core is tilted."""
    of = task()
    generator = torch.Generator().manual_seed(0)
    qpos = torch.randn(50, 13, generator=generator, dtype=torch.float64)
    qpos[:, 3:7] /= qpos[:, 3:7].norm(dim=-1, keepdim=True)
    env = LocomotionEnv(of, 50, readings=[])
    env.set_state(qpos, torch.zeros(50, env.model.nv))
    front = env.physics.field("xmat")[:, 1].reshape(50, 3, 3)[:, :, 0]
    torch.testing.assert_close(env.state.heading, front[:, 1].atan2(front[:, 0]))


def test_work_is_that_of_the_state():
    of, work = task(), torch.tensor([0.5, 2.0])
    places = [(0.0, 0.0)] * 2
    after = state(of, places, work=work)
    assert Work().weight == -0.01
    assert torch.equal(Work()(state(of, places), after), work)


EACH = [
    Distance(),
    Velocity(direction=0.7),
    Heading(heading=-2.0),
    Work(weight=1.0),
]
MIXED = [
    dataclasses.replace(reward, weight=weight) for reward, weight in zip(EACH, (2, -1, 0.5, 3))
]


@pytest.mark.parametrize("paid", [*([reward] for reward in EACH), MIXED])
def test_dm_controls_environment_pays_the_same(paid):
    env = LocomotionEnv(task(*paid), 2)
    reference = composer.Environment(env.task, random_state=0)
    rng, total = np.random.default_rng(0), 0.0
    for _ in range(2):  # also in the next episode
        reference.reset()
        data = reference.physics.data
        env.set_state(torch.tensor(data.qpos), torch.tensor(data.qvel))
        td = env.fake_tensordict()
        for _ in range(5):
            action = rng.uniform(-1.5, 1.5, env.model.nu)
            td["action"] = torch.as_tensor(action).expand(2, -1)
            expected = reference.step(action).reward
            td = env.step(td)["next"]
            assert td["reward"].squeeze(-1).tolist() == pytest.approx([expected] * 2, abs=1e-6)
            total += abs(expected)
    assert total > 0.1


def test_weights_add_up(stepping):
    def walk(*paid):
        env = LocomotionEnv(task(*paid), 3, seed=0, physics=stepping)
        torch.manual_seed(0)
        return env.rollout(6)["next", "reward"].cpu()

    # Work is watched in every physics step, in which Warp rounds at other times.
    watched = Work(weight=0.0)
    expected = sum(
        reward.weight * walk(dataclasses.replace(reward, weight=1.0), watched) for reward in MIXED
    )
    torch.testing.assert_close(walk(*MIXED), expected, atol=1e-5, rtol=1e-4)


def test_a_task_without_rewards_pays_nothing():
    env = LocomotionEnv(task(), 2)
    assert not env.rollout(2)["next", "reward"].any()
    reference = composer.Environment(env.task, random_state=0)
    reference.reset()
    assert reference.step(np.zeros(6)).reward == 0


class Lazy(LocomotionEnv):
    """Robots that are paid for the height they have gained, and for holding still at the end."""

    def reward(self, before, after):
        risen = after.field("qpos")[:, 2] - before.field("qpos")[:, 2]
        return risen - after.field("qvel").norm(dim=-1)


def test_a_subclass_with_its_own_reward_is_honoured(stepping):
    env = Lazy("gecko", 3, seed=0, physics=stepping)
    td = env.reset()
    for _ in range(4):
        height = env.physics.qpos[:, 2].clone()
        td = env.step(env.rand_action(td))["next"]
        expected = env.physics.qpos[:, 2] - height - env.physics.qvel.norm(dim=-1)
        torch.testing.assert_close(td["reward"].squeeze(-1), expected.float())


@dataclasses.dataclass
class Tall(Reward):
    """Height of the core (m)."""

    def __call__(self, before, after):
        return after.field("qpos")[:, 2]


def test_a_reward_of_ones_own_is_one_of_the_task():
    env = LocomotionEnv(task(Tall(weight=3.0)), 2)
    td = env.rollout(3)[:, -1]["next"]
    torch.testing.assert_close(td["reward"].squeeze(-1), (3 * env.physics.qpos[:, 2]).float())


def test_rewards_are_chosen_by_name():
    options = TaskConfig({"velocity": {"weight": 2.0, "direction": 1.0}, "work": None})
    assert make_task(GECKO, task=options).rewards == (Velocity(2.0, 1.0), Work())
    assert make_task(GECKO).rewards == (Distance(),)
    assert {"distance", "velocity", "heading", "work"} <= set(rewards.names())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"velocty": {}}, "task.rewards=velocty is unknown; did you mean velocity?"),
        ({"velocity": {"speed": 1}}, "task.rewards.velocity.speed is not a key"),
        ({"velocity": {"weight": math.inf}}, "weight"),
    ],
)
def test_a_reward_that_cannot_be_paid_is_named(options, message):
    with pytest.raises(ConfigError) as caught:
        make_task(GECKO, task=TaskConfig(options))
    assert message in str(caught.value)
