"""The environment: starts, episodes, actions, seeds and specs, on whatever steps the robots."""

from functools import partial

import mujoco
import numpy as np
import pytest
import torch
import yaml
from dm_control import composer
from torchrl.envs import ParallelEnv, SerialEnv, check_env_specs

from locomotion.envs import LocomotionEnv, make_task
from locomotion.options import ConfigError, conf_dir
from locomotion.robots import load_robot


@pytest.mark.parametrize("robot", ["gecko", "ant"])
def test_dm_controls_environment_and_the_batched_one_agree(robot):
    env = LocomotionEnv(robot, 3, seed=0)
    reference = composer.Environment(env.task, random_state=0)
    reference.reset()
    physics = reference.physics
    env.set_state(torch.tensor(physics.data.qpos), torch.tensor(physics.data.qvel))
    rng = np.random.default_rng(0)
    td = env.fake_tensordict()
    for _ in range(10):
        action = rng.uniform(-1.5, 1.5, env.model.nu)  # beyond the limits: both must clip
        expected = reference.step(action)
        td["action"] = torch.as_tensor(action).expand(3, -1)
        reached = env.step(td)["next"]
        for row in range(3):
            np.testing.assert_allclose(env.physics.qpos[row], physics.data.qpos, atol=1e-9, rtol=0)
            np.testing.assert_allclose(env.physics.qvel[row], physics.data.qvel, atol=1e-9, rtol=0)
        np.testing.assert_allclose(reached["reward"], expected.reward, atol=1e-6)


def test_a_control_step_is_as_many_mujoco_steps(make, stepping):
    env = make(2, physics={"timestep": 0.005}, control_frequency=5.0)
    env.reset()
    data = mujoco.MjData(env.model)
    data.qpos[:], data.qvel[:] = env.physics.qpos[1].cpu(), env.physics.qvel[1].cpu()
    data.ctrl[:] = 0.3
    mujoco.mj_step(env.model, data, 40)
    td = env.fake_tensordict()
    td["action"].fill_(0.3)
    td = env.step(td)["next"].cpu()
    off = {"threaded": 1e-8, "warp": 1e-4}[stepping["backend"]]
    np.testing.assert_allclose(env.physics.qpos[1].cpu(), data.qpos, atol=off)
    np.testing.assert_allclose(td["hinge_velocity"][1], data.qvel[6:], atol=1e-6 + 10 * off)
    np.testing.assert_allclose(td["core_position"][1], data.qpos[:3], atol=off)


def test_specs_hold_and_all_is_on_the_device(make):
    env = make(4, "ant")
    check_env_specs(env)
    td = env.reset()
    assert set(td.keys()) == {
        *("hinge_position", "hinge_velocity", "core_orientation", "core_position"),
        *("done", "terminated", "truncated"),
    }
    assert td["core_position"].dtype == torch.float64
    assert len(env.hinge_names) == env.model.nu == 8
    rollout = env.rollout(2)
    assert {value.device for value in rollout.flatten_keys().values()} == {env.physics.device}


def test_only_the_chosen_readings_are_written():
    env = LocomotionEnv("gecko", 2, seed=0, readings=["core_position"])
    check_env_specs(env)
    assert set(env.observation_spec.keys()) == {"core_position"}


def test_robots_start_settled_and_differently(make):
    td = make(8).reset()
    assert td["hinge_position"].std(0).min() > 0.1
    assert td["core_position"][:, 2].max() < 0.2
    assert (td["core_position"][:, :2].norm(dim=-1) < 0.3).all()


def test_starts_are_the_same_wherever_robots_are_stepped(make):
    start = make(4).reset()["hinge_position"].cpu()
    expected = LocomotionEnv("gecko", 4, seed=0).reset()["hinge_position"]
    torch.testing.assert_close(start, expected, atol=0.05, rtol=0)


@pytest.mark.parametrize("away", [0.0, 5000.0])
def test_robots_walk_kilometres_away_as_at_the_start(away, make, stepping):
    """And the reward is the distance gained."""
    env = make(2)
    td = env.reset()
    qpos, qvel = env.physics.qpos.clone(), env.physics.qvel.clone()
    walks = []
    for offset in (0.0, away):
        start = qpos.clone()
        start[:, :2] += offset
        env.set_state(start, qvel)
        torch.manual_seed(0)
        walk = env.rollout(20, auto_reset=False, tensordict=td.clone())["next"].cpu()
        walks.append(walk)
        gained = (walk["core_position"][:, -1, :2] - start[:, :2].cpu()).norm(dim=-1)
        torch.testing.assert_close(walk["reward"].sum((1, 2)), gained.float(), atol=1e-5, rtol=0)
    here, there = walks
    if stepping.get("device") != "cuda:0":  # there the order of additions varies
        off = {"threaded": 1e-6, "warp": 0.0}[stepping["backend"]]
        torch.testing.assert_close(
            there["hinge_position"], here["hinge_position"], atol=off, rtol=0
        )


def test_without_settling_robots_start_straight_and_at_rest(make):
    env = make(2, settle_time=0.0)
    td = env.reset()
    assert not td["hinge_position"].any() and not td["hinge_velocity"].any()
    reference = composer.Environment(env.task, random_state=0)
    reference.reset()
    np.testing.assert_array_equal(td["core_position"][0].cpu(), reference.physics.data.qpos[:3])


@pytest.mark.parametrize("limit", [1.0, 0.4])
def test_actions_are_clipped_inside_and_left_alone_outside(limit):
    env = LocomotionEnv("gecko", 2, seed=0, target_limit=limit)
    assert (env.action_spec.space.high == limit).all()
    spec = composer.Environment(env.task).action_spec()
    assert (spec.maximum == limit).all() and (spec.minimum == -limit).all()
    env.reset()
    qpos, qvel = env.physics.qpos[:1].clone(), env.physics.qvel[:1].clone()
    td = env.fake_tensordict()
    reached = []
    for target in (limit, 7.0):
        env.set_state(qpos, qvel)
        td["action"] = torch.full((2, 6), target)
        after = env.step(td)
        assert (after["action"] == target).all()
        reached.append(after["next", "hinge_position"])
    assert torch.equal(*reached)
    td["action"] = torch.full((2, 6), 0.9 * limit)
    env.set_state(qpos, qvel)
    assert not torch.equal(env.step(td)["next", "hinge_position"], reached[0])


def test_same_seed_same_rollout_whatever_the_threads():
    def rollout(seed, threads):
        env = LocomotionEnv("gecko", 7, seed=seed, physics={"threads": threads})
        torch.manual_seed(0)
        return env.rollout(4)

    reference = rollout(3, 1)
    assert (rollout(3, 1) == reference).all()
    assert (rollout(3, 2) == reference).all()
    assert (rollout(3, 5) == reference).all()
    assert not (rollout(4, 1)["hinge_position"] == reference["hinge_position"]).any()


def test_set_seed_restarts_the_random_starts():
    env = LocomotionEnv("gecko", 3)
    env.set_seed(5)
    first = env.reset()
    env.set_seed(5)
    assert (env.reset() == first).all()


def test_a_partial_reset_touches_only_its_robots(make):
    env = make(4)
    td = env.rollout(3)[:, -1]["next"]
    before = env.physics.motion.clone()
    where = torch.tensor([[False], [True], [False], [True]], device=before.device)
    fresh = env.reset(td.clone().set("_reset", where))
    kept = ~where.squeeze(-1)
    assert torch.equal(env.physics.motion[kept], before[kept])
    assert torch.equal(fresh["hinge_position"][kept], td["hinge_position"][kept])
    assert (fresh["hinge_position"][~kept] != td["hinge_position"][~kept]).all()
    # The distance from the start begins anew for these alone.
    place = env.physics.qpos[:, :2].cpu().clone()
    assert torch.equal(env.state.start.cpu()[~kept.cpu()], place[~kept.cpu()])
    assert not torch.equal(env.state.start.cpu()[kept.cpu()], place[kept.cpu()])


def test_set_state_begins_an_episode_of_the_robots_that_it_is_told(make):
    env = make(3, disturbances={"latency": 0.1}, time_limit=1.0)
    td = env.rollout(2)[:, -1]["next"]
    before = env.physics.motion.clone()
    where = torch.tensor([False, True, False], device=before.device)
    qpos, qvel = before[0:1, 1 : 1 + env.model.nq], before[:, 1 + env.model.nq :]
    env.set_state(qpos, qvel[0], where)
    assert torch.equal(env.physics.motion[[0, 2]], before[[0, 2]])
    assert torch.equal(env.physics.motion[1, 1:], before[0, 1:])
    assert not env.physics.control[1].any()
    ends = []
    for _ in range(4):
        td = env.step(td.set("action", torch.zeros_like(env.physics.control)))["next"]
        ends.append(td["truncated"].squeeze(-1).tolist())
    assert ends[1] == [True, False, True] and ends[3][1]


def test_an_episode_never_ends_unless_there_is_a_time_limit(make):
    assert not make(2).rollout(6)["next", "done"].any()
    rollout = make(2, time_limit=1.0).rollout(12, break_when_any_done=False)
    ends = torch.arange(12, device=rollout.device) % 4 == 3  # 1 s at 4 Hz
    assert torch.equal(rollout["next", "truncated"][0, :, 0], ends)
    assert torch.equal(rollout["next", "done"], rollout["next", "truncated"])
    assert not rollout["next", "terminated"].any()


@pytest.mark.parametrize("batched", [SerialEnv, pytest.param(ParallelEnv, marks=pytest.mark.slow)])
def test_torchrls_batched_environments_take_it(batched):
    env = batched(2, partial(LocomotionEnv, "gecko", 3, physics={"threads": 1}))
    try:
        check_env_specs(env)
        env.set_seed(0)
        rollout = env.rollout(2)
        assert rollout.shape == (2, 3, 2)
        assert not torch.equal(rollout["hinge_position"][0], rollout["hinge_position"][1])
    finally:
        env.close()


def test_a_task_may_be_a_name_a_file_a_mapping_or_a_task(tmp_path):
    body = yaml.safe_load((conf_dir() / "robot" / "gecko.yaml").read_text())
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump({**body, "name": "mine"}))
    task = make_task(load_robot("gecko"))
    tasks = ("gecko", body, file, str(file), load_robot("gecko"), task)
    assert len({LocomotionEnv(task, 1).hinge_names for task in tasks}) == 1
    assert LocomotionEnv(task, 1).task is task


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"task": "lizard"}, "robot=lizard is unknown; choose from ant, "),
        ({"task": "nowhere.yaml"}, "nowhere.yaml"),
        ({"task": {"name": "x", "body": {"module": "core"}}}, "the body has no hinge"),
        ({"physics": {"timestep": 0.03}}, "physics.timestep=0.03 must divide"),
        ({"physics": {"threads": 0}}, "physics.threads=0 must be at least 1"),
        ({"physics": {"speed": 1}}, "physics.speed is not a key"),
        ({"num_envs": 0}, "env.num_envs=0 must be at least 1"),
        ({"control_frequency": 0.0}, "env.control_frequency=0.0 must be above 0"),
        ({"time_limit": 0.1}, "env.time_limit=0.1 must be at least 0.25, one action"),
        ({"readings": ["hinge_positon"]}, "did you mean hinge_position? choose from"),
    ],
)
def test_mistakes_from_python_are_named(arguments, message):
    with pytest.raises(ConfigError) as caught:
        LocomotionEnv(**arguments)
    assert message in str(caught.value)


def test_a_task_that_is_given_has_its_own_settings():
    with pytest.raises(ConfigError, match="settle_time is a setting of the task, which was given"):
        LocomotionEnv(make_task(load_robot("gecko")), 1, settle_time=1.0)


def test_watching_every_physics_step_changes_nothing():
    watched, plain = (LocomotionEnv("ant", 3, seed=0) for _ in range(2))
    places = []
    trajectories = []
    with watched.after_substep(lambda physics: places.append(physics.qpos[:, :2].clone())):
        for env in (watched, plain):
            torch.manual_seed(0)
            trajectories.append(env.rollout(6))
    watched.rollout(1)  # after the block nobody looks any more
    assert (trajectories[0] == trajectories[1]).all()
    assert len(places) == 6 * 25
    torch.testing.assert_close(places[24], trajectories[0]["next", "core_position"][:, 0, :2])


def test_its_state_decides_all_that_comes_next(make):
    """Starts, episodes and rewards of another one that is given the state."""
    first, second = (make(3, time_limit=1.0, disturbances={"latency": 0.1}) for _ in range(2))
    first.rollout(6, break_when_any_done=False)
    state = first.state_dict()
    walks = []
    for env in (first, second):
        env.load_state_dict(state)
        torch.manual_seed(0)
        walks.append(
            env.rollout(
                9,
                auto_reset=False,
                break_when_any_done=False,
                tensordict=env.fake_tensordict().exclude("next", "action").zero_(),
            ).cpu()
        )
    exact = first.physics.device.type == "cpu"
    for key in (("next", "hinge_position"), ("next", "reward"), ("next", "truncated")):
        one, other = (walk[key].double() for walk in walks)
        torch.testing.assert_close(one, other, atol=0.0 if exact else 0.1, rtol=0)
