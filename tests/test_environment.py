"""The environment against MuJoCo, dm-control and closed forms."""

from functools import partial

import mujoco
import numpy as np
import pytest
import torch
import yaml
from dm_control import composer
from torchrl.envs import ParallelEnv, SerialEnv, check_env_specs

from locomotion.config import ConfigError, conf_dir
from locomotion.envs import LocomotionEnv

ONE_THREAD = {"threads": 1}


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
            np.testing.assert_allclose(env._physics.qpos[row], physics.data.qpos, atol=1e-9, rtol=0)
            np.testing.assert_allclose(env._physics.qvel[row], physics.data.qvel, atol=1e-9, rtol=0)
        np.testing.assert_allclose(reached["reward"], expected.reward, atol=1e-6)
        observed = {key.split("/")[-1]: value for key, value in expected.observation.items()}
        for key in ("hinge_position", "core_orientation"):
            np.testing.assert_allclose(reached[key][0], np.ravel(observed[key]), atol=1e-6)


def test_a_control_step_is_that_many_mujoco_steps():
    env = LocomotionEnv("gecko", 2, seed=0, physics={"timestep": 0.005}, control_frequency=5.0)
    env.reset()
    data = mujoco.MjData(env.model)
    data.qpos[:], data.qvel[:] = env._physics.qpos[1], env._physics.qvel[1]
    data.ctrl[:] = 0.3
    mujoco.mj_step(env.model, data, 40)
    td = env.fake_tensordict()
    td["action"] = torch.full((2, 6), 0.3, dtype=torch.float64)
    td = env.step(td)["next"]
    np.testing.assert_allclose(env._physics.qpos[1], data.qpos, atol=1e-12)
    np.testing.assert_allclose(td["hinge_velocity"][1], data.qvel[6:], rtol=1e-6)
    np.testing.assert_allclose(td["core_position"][1], data.qpos[:3], atol=1e-12)


def test_specs_hold_and_observations_are_what_they_say():
    env = LocomotionEnv("ant", 5, seed=1)
    check_env_specs(env)
    td = env.reset()
    assert set(td.keys()) == {
        *("hinge_position", "hinge_velocity", "core_orientation", "core_position"),
        *("done", "terminated", "truncated"),
    }
    torch.testing.assert_close(td["core_orientation"].norm(dim=-1), torch.ones(5))
    assert td["core_position"].dtype == torch.float64
    assert len(env.hinge_names) == env.model.nu == 8


def test_only_the_chosen_observations_are_written():
    env = LocomotionEnv("gecko", 2, seed=0, observations=["core_position"])
    check_env_specs(env)
    assert set(env.observation_spec.keys()) == {"core_position"}


def test_robots_start_settled_and_differently():
    env = LocomotionEnv("gecko", 8, seed=0)
    td = env.reset()
    assert td["hinge_position"].std(0).min() > 0.1
    assert td["core_position"][:, 2].max() < 0.2
    assert (td["core_position"][:, :2].norm(dim=-1) < 0.3).all()


@pytest.mark.parametrize("offset", [0.0, 5000.0])
def test_reward_is_the_distance_gained_even_far_away(offset):
    env = LocomotionEnv("gecko", 1, seed=0)
    env.reset()
    env._physics.qpos[:, :2] += offset
    env._start += offset
    total, td = 0.0, env.fake_tensordict()
    for _ in range(20):
        td = env.step(env.rand_action(td))["next"]
        total += td["reward"].item()
    walked = td["core_position"][0, :2] - env._start[0]
    assert total == pytest.approx(walked.norm().item(), abs=1e-6)


def test_without_settling_robots_start_straight_and_at_rest():
    env = LocomotionEnv("gecko", 2, seed=0, settle_time=0.0)
    td = env.reset()
    assert not td["hinge_position"].any()
    reference = composer.Environment(env.task, random_state=0)
    reference.reset()
    np.testing.assert_array_equal(td["core_position"][0], reference.physics.data.qpos[:3])


@pytest.mark.parametrize("limit", [1.0, 0.4])
def test_actions_are_clipped_inside_and_left_alone_outside(limit):
    env = LocomotionEnv("gecko", 2, seed=0, target_limit=limit)
    assert (env.action_spec.space.high == limit).all()
    spec = composer.Environment(env.task).action_spec()
    assert (spec.maximum == limit).all() and (spec.minimum == -limit).all()
    env.reset()
    qpos, qvel = env._physics.qpos[:1].clone(), env._physics.qvel[:1].clone()
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


def test_a_partial_reset_touches_only_its_robots():
    env = LocomotionEnv("gecko", 4, seed=0)
    td = env.rollout(3)[:, -1]["next"]
    before = env._physics.qpos.clone()
    where = torch.tensor([[False], [True], [False], [True]])
    fresh = env.reset(td.clone().set("_reset", where))
    kept = ~where.squeeze(-1)
    assert torch.equal(env._physics.qpos[kept], before[kept])
    assert torch.equal(fresh["hinge_position"][kept], td["hinge_position"][kept])
    assert (fresh["hinge_position"][~kept] != td["hinge_position"][~kept]).all()
    assert torch.equal(env._start[~kept], env._physics.qpos[~kept, :2])


def test_an_episode_never_ends_unless_there_is_a_time_limit():
    endless = LocomotionEnv("gecko", 2, seed=0).rollout(12)
    assert not endless["next", "done"].any()
    limited = LocomotionEnv("gecko", 2, seed=0, time_limit=1.0)
    rollout = limited.rollout(12, break_when_any_done=False)
    ends = torch.arange(12) % 4 == 3  # 1 s at 4 Hz
    assert torch.equal(rollout["next", "truncated"][0, :, 0], ends)
    assert torch.equal(rollout["next", "done"], rollout["next", "truncated"])
    assert not rollout["next", "terminated"].any()


@pytest.mark.parametrize("batched", [SerialEnv, ParallelEnv])
def test_torchrls_batched_environments_take_it(batched):
    env = batched(2, partial(LocomotionEnv, "gecko", 3, physics=ONE_THREAD))
    try:
        check_env_specs(env)
        env.set_seed(0)
        rollout = env.rollout(2)
        assert rollout.shape == (2, 3, 2)
        assert not torch.equal(rollout["hinge_position"][0], rollout["hinge_position"][1])
    finally:
        env.close()


def test_a_robot_may_be_a_name_a_file_or_a_mapping(tmp_path):
    body = yaml.safe_load((conf_dir() / "robot" / "gecko.yaml").read_text())
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump({**body, "name": "mine"}))
    names = {LocomotionEnv(robot, 1).hinge_names for robot in ("gecko", body, file, str(file))}
    assert len(names) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"robot": "lizard"}, "robot=lizard is unknown; choose from ant, gecko"),
        ({"robot": "nowhere.yaml"}, "nowhere.yaml"),
        ({"physics": {"timestep": 0.03}}, "physics.timestep=0.03 must divide"),
        ({"physics": {"threads": 0}}, "physics.threads=0 must be at least 1"),
        ({"physics": {"speed": 1}}, "physics.speed is no key"),
        ({"num_envs": 0}, "env.num_envs=0 must be at least 1"),
        ({"control_frequency": 0.0}, "env.control_frequency=0.0 must be above 0"),
        ({"time_limit": 0.1}, "env.time_limit=0.1 must be at least 0.25, one action"),
        (
            {"observations": ["colour"]},
            "observation 'colour' is unknown; choose from hinge_position",
        ),
        ({"robot": {"name": "x", "body": {"module": "core"}}}, "the body has no hinge"),
    ],
)
def test_mistakes_from_python_are_named(arguments, message):
    with pytest.raises(ConfigError) as caught:
        LocomotionEnv(**arguments)
    assert message in str(caught.value)


@pytest.mark.parametrize("self_collision", [False, True])
def test_limbs_pass_through_one_another_unless_told_not_to(self_collision):
    physics = {"self_collision": self_collision, "threads": 1}
    env = LocomotionEnv("ant", 1, seed=0, physics=physics)
    data = mujoco.MjData(env.model)
    data.qpos[2] = 50.0  # it falls all the while, and does not reach the ground
    touched = set()
    for _ in range(200):
        data.ctrl[:] = np.sin(3 * data.time + np.arange(env.model.nu))
        mujoco.mj_step(env.model, data)
        touched |= {frozenset(contact.geom.tolist()) for contact in data.contact}
    assert bool(touched) == self_collision
    # What is on the two sides of a hinge never collides.
    bodies = env.model.geom_bodyid
    for pair in touched:
        one, other = bodies[list(pair)]
        assert env.model.body_parentid[one] != other != one != env.model.body_parentid[other]


def test_scales_multiply_masses_and_torques():
    def env(**physics):
        return LocomotionEnv("gecko", 1, seed=0, physics={"threads": 1, **physics}).model

    plain, scaled = env(), env(mass_scale=1.5, strength_scale=0.5)
    np.testing.assert_allclose(scaled.body_mass, 1.5 * plain.body_mass)
    np.testing.assert_allclose(scaled.body_inertia, 1.5 * plain.body_inertia)
    for array in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange"):
        np.testing.assert_allclose(getattr(scaled, array), 0.5 * getattr(plain, array))


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
