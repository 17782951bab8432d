"""Walking with a policy, against closed forms and against MuJoCo's own stepping."""

import dataclasses
import math

import mujoco
import numpy as np
import pytest
import torch
from omegaconf import OmegaConf

from locomotion.assembly import make_env
from locomotion.command_line.composing import compose
from locomotion.command_line.policies import POLICIES, shipped
from locomotion.config import Config, typed
from locomotion.gaits import (
    CHANGES,
    Disturbances,
    Walk,
    Walker,
    make_walker,
    measure,
    shares,
    summarise,
    walk,
)
from locomotion.runs import read_config

LEVEL = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64)


def made_up(places, overturns=0.0, work=1.0, orientation=LEVEL):
    """The walk of one robot at 4 Hz through places ``(steps + 1, 2)``."""
    places = torch.as_tensor(places, dtype=torch.float64)
    steps = len(places) - 1
    position = torch.cat([places, torch.full((steps + 1, 1), 0.05)], 1).unsqueeze(1)
    overturns = torch.as_tensor(overturns, dtype=torch.float64).expand(steps, 1)
    joules = torch.full((steps, 1), work)
    still = torch.zeros(1, dtype=torch.bool)
    return Walk(0.25, position, orientation.expand(steps + 1, 1, 4), joules, overturns, still)


def test_a_straight_line():
    # 80 steps of 0.1 m along y, each with half a joule and a tenth of a turn over.
    places = [(0.0, 0.1 * step) for step in range(81)]
    found = measure(made_up(places, overturns=0.1, work=0.5))
    expected = {
        "speed": 0.4,
        "distance": 8.0,
        "straightness": 1.0,
        "heading_drift": 0.0,
        "work_per_metre": 5.0,
        "rolls_per_metre": 0.5,
        "on_back": 0.0,
        "diverged": 0.0,
    }
    assert {name: value.item() for name, value in found.items()} == pytest.approx(expected)


def test_a_quarter_circle_drifts():
    angles = np.linspace(0, math.pi / 2, 241)  # one minute
    circle = 20 * np.stack([np.sin(angles), 1 - np.cos(angles)], 1)
    found = measure(made_up(circle))
    # Chords of the two halves are 45 degrees apart, and half a minute.
    assert found["heading_drift"].item() == pytest.approx(90.0)
    assert found["distance"].item() == pytest.approx(20 * math.sqrt(2))
    assert found["straightness"].item() == pytest.approx(2 * math.sqrt(2) / math.pi, rel=1e-3)


def test_upside_down_and_diverged():
    overturned = torch.tensor([0.0, 1.0, 0.0, 0.0], dtype=torch.float64)
    places = [(0.0, 0.0), (1.0, 0.0)]
    assert measure(made_up(places, orientation=overturned))["on_back"].item() == 1
    lost = dataclasses.replace(made_up(places), diverged=torch.ones(1, dtype=torch.bool))
    found = measure(lost)
    assert found["speed"].isnan().all()
    assert found["diverged"].item() == 1
    assert summarise(found)["diverged"].mean == 1


def test_intervals_cover_the_mean_as_often_as_they_say():
    generator = torch.Generator().manual_seed(0)
    covered = 0
    for _ in range(400):
        values = 2 + torch.randn(10, generator=generator, dtype=torch.float64)
        interval = summarise({"speed": values})["speed"]
        covered += interval.low < 2 < interval.high
    assert 0.92 < covered / 400 < 0.98
    none = summarise({"on_back": torch.zeros(64, dtype=torch.float64)})["on_back"]
    assert (none.mean, none.low) == (0, pytest.approx(0))
    assert none.high == pytest.approx(0.0566, abs=1e-3)  # Wilson: z² / (n + z²)


def scripted(config, disturbances=None, amplitude=1.0):
    """Robots that are moved by a sine, whatever they sense, and the sensed positions."""
    env = make_env(config)
    sensed = []

    def policy(td):
        sensed.append(td["hinge_position_history"].clone())
        phase = torch.arange(env.action_spec.shape[-1])
        return td.set(
            "action", (amplitude * torch.sin(len(sensed) + phase)).expand(env.action_spec.shape)
        )

    return Walker(env, policy, 0.25, disturbances or Disturbances(), seed=0), sensed


@pytest.fixture
def config():
    return compose("env.num_envs=3", "ppo.steps=1", "ppo.minibatch_size=1", "physics.threads=1")


def test_work_is_that_of_mujocos_own_steps(config):
    config.physics.stiffness = 5.0  # so that torques reach their limit
    walker, _ = scripted(config)
    walked = walk(walker, 2.0, effort=True)
    model = walker.env.base_env.model
    data = mujoco.MjData(model)
    again, _ = scripted(config)
    again.start()
    physics = again.env.base_env.physics
    data.qpos[:], data.qvel[:] = physics.qpos[1], physics.qvel[1]
    limited = False
    for step in range(8):
        again.step(sampled=False)
        data.ctrl[:] = again.action[1]
        work = 0.0
        for _ in range(25):
            mujoco.mj_step(model, data)
            mujoco.mj_forward(model, data)  # the forces of the new state
            work += 0.01 * np.abs(data.actuator_force * data.qvel[6:]).sum()
            limited |= np.any(np.abs(data.actuator_force) > 0.948)
        assert walked.work[step, 1].item() == pytest.approx(work, rel=1e-6)
    assert limited


def test_a_core_that_spins_turns_over_twice_in_a_turn_and_one_that_rocks_does_not(config):
    config.env.settle_time = 0.0
    walker, _ = scripted(config, amplitude=0.0)
    start = walker.start

    def thrown():
        start()
        physics = walker.env.base_env.physics
        physics.qpos[:, 2] = 8.0  # free flight, for long enough
        physics.qvel[:, 3] = torch.tensor([0.0, 2 * math.pi, 0.0])  # the second turns once a second
        physics.qpos[2, 3:7] = torch.tensor([math.cos(0.45), math.sin(0.45), 0.0, 0.0])

    walker.start = thrown
    overturns = walk(walker, 1.0, effort=True).overturns.sum(0)
    assert overturns.tolist() == [0, 2, 0]


def test_targets_come_late_by_so_many_steps(config):
    walker, _ = scripted(config, Disturbances(delay=2))
    walker.start()
    held = walker.env.base_env.observe()["hinge_position"]
    actions = []
    for _ in range(5):
        walker.step(sampled=False)
        actions.append(walker.action[0])
    torch.testing.assert_close(actions[0], held[0])
    torch.testing.assert_close(actions[1], held[0])
    for step, action in enumerate(actions[2:], start=1):
        torch.testing.assert_close(action, torch.sin(step + torch.arange(6)))


def test_noise_is_in_what_is_sensed_and_nowhere_else(config):
    config.env.num_envs = 200
    (quiet, clean), (noisy, disturbed) = scripted(config), scripted(config)
    from locomotion.gaits.walking import SensorNoise

    noisy.env.insert_transform(0, SensorNoise(0.05, ["hinge_position"]))
    for walker in (quiet, noisy):
        walk(walker, 1.0)
    difference = torch.stack(disturbed) - torch.stack(clean)
    assert difference.std().item() == pytest.approx(0.05, rel=0.05)
    physics = [walker.env.base_env.physics for walker in (quiet, noisy)]
    assert (physics[0].qpos == physics[1].qpos).all()


def test_a_push_changes_the_velocity_once_in_ten_seconds(config):
    walker, _ = scripted(config, Disturbances(push=0.5))
    walker.start()
    pushed = []
    step = walker.env.base_env.advance
    velocity = walker.env.base_env.physics.qvel

    def advance(*arguments):
        pushed.append(velocity.clone())
        return step(*arguments)

    walker.env.base_env.advance = advance
    for _ in range(41):
        before = velocity.clone()
        walker.step(sampled=False)
        pushed[-1] -= before
    where = [step for step, change in enumerate(pushed) if change.any()]
    assert where == [20]
    torch.testing.assert_close(
        pushed[20][:, :2].norm(dim=-1), torch.full((3,), 0.5, dtype=torch.float64)
    )
    assert not pushed[20][:, 2:].any()


def task_of(robot, num_envs, **physics):
    """The task that a policy which comes along was trained on, for so many robots."""
    saved = OmegaConf.create(read_config(POLICIES / robot))
    saved.env.num_envs = num_envs
    saved.ppo.update(steps=1, minibatch_size=1)
    saved.physics.update(threads=1, **physics)
    return POLICIES / robot, typed(Config, saved)


@pytest.mark.parametrize("robot", shipped())
def test_the_policies_that_come_along_walk(robot):
    run, config = task_of(robot, 16)
    found = summarise(measure(walk(make_walker(run, config), 20.0)))
    # The report's gaits cover 0.09 m in a quarter of a second, noise and all.
    assert found["speed"].low > 0.35
    assert found["straightness"].mean > 0.8
    assert found["diverged"].mean == 0


def test_the_reality_check_changes_one_thing_at_a_time():
    run, config = task_of("gecko", 4, self_collision=False)
    steps = []
    nominal = measure(walk(make_walker(run, config), 1.0))["speed"]
    rows = shares(run, config, Disturbances(), 1.0, nominal, progress=lambda: steps.append(1))
    assert len(steps) == 4 * len(CHANGES)
    assert [row.override for row in rows] == [
        *("physics.timestep=0.001", "physics.self_collision=true"),
        *("physics.friction=0.5", "physics.friction=1.5"),
        *("physics.strength_scale=0.8", "physics.strength_scale=1.2"),
        *("physics.mass_scale=0.8", "physics.mass_scale=1.2"),
        *("delay=1", "noise=0.05", "push=0.5"),
    ]
    for row in rows:
        assert row.share.low < row.share.mean < row.share.high
        if row.override.startswith("physics."):
            compose(row.override)
