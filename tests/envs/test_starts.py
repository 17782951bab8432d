"""Starts with any heading, upright or overturned."""

import math

import mujoco
import numpy as np
import pytest
import torch
from dm_control import composer
from scipy.spatial.transform import Rotation

from locomotion.envs import LocomotionEnv
from locomotion.envs.making import make_task
from locomotion.envs.observables import add_observables
from locomotion.robots import load_robot
from locomotion.tasks.options import EnvConfig, Start


def lowest(model, qpos):
    """Height of the lowest corner of the robot's boxes."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    boxes = [
        geom for geom in range(model.ngeom) if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX
    ]
    return min(
        data.geom_xpos[geom][2]
        - np.abs(data.geom_xmat[geom].reshape(3, 3)[2]) @ model.geom_size[geom]
        for geom in boxes
    )


@pytest.mark.parametrize("robot", ["gecko", "spider", "zappa"])
def test_robots_start_on_the_ground_with_any_heading_and_half_of_them_overturned(robot):
    env = LocomotionEnv(robot, 200, start="any", settle_time=0.0, seed=0)
    env.reset()
    assert all(
        lowest(env.model, qpos) == pytest.approx(0, abs=1e-9) for qpos in env.physics.qpos[:20]
    )
    w, x, y, z = env.physics.qpos[:, 3:7].unbind(-1)
    up = 1 - 2 * (x**2 + y**2)
    torch.testing.assert_close(up.abs(), torch.ones_like(up))
    assert 70 < (up < 0).sum() < 130
    heading = torch.atan2(2 * (x * y + w * z), 1 - 2 * (y**2 + z**2))
    quarters = torch.histc(heading, 4, -math.pi, math.pi)
    assert (quarters > 25).all()
    env.close()


def test_a_robot_that_is_put_back_starts_anew_and_others_walk_on():
    env = LocomotionEnv("gecko", 6, start="any", seed=0)
    start = env.reset()
    where = torch.tensor([True, False] * 3)
    before = env.physics.motion.clone()
    env.reset(start.select().set("_reset", where[:, None]))
    assert (env.physics.motion[where] != before[where]).any(-1).all()
    assert torch.equal(env.physics.motion[~where], before[~where])
    env.close()


def test_dm_control_starts_so_too():
    def orientations(start):
        task = make_task(load_robot("gecko"), env=EnvConfig(start=start, settle_time=0.0))
        env = composer.Environment(task, random_state=0)
        for _ in range(12):
            env.reset()
            yield env.physics.data.qpos[3:7].copy()

    assert all(np.allclose(quat, (1, 0, 0, 0)) for quat in orientations(Start.upright))
    up = [1 - 2 * (x**2 + y**2) for _, x, y, _ in orientations(Start.any)]
    np.testing.assert_allclose(np.abs(up), 1)
    assert 0 < sum(value < 0 for value in up) < 12


def matrices(quaternions):
    turned = Rotation.from_quat(quaternions.numpy(), scalar_first=True)
    return turned.as_matrix()


@pytest.mark.parametrize("start", ["upright", "any"])
def test_without_a_compass_a_robot_senses_its_heading_from_the_one_at_the_start(start):
    env = LocomotionEnv("gecko", 8, start=start, compass=False, settle_time=0.0, seed=0)
    env.reset()
    w, x, y, z = env.physics.qpos[:, 3:7].clone().unbind(-1)
    faced = torch.atan2(2 * (x * y + w * z), 1 - 2 * (y**2 + z**2)).numpy()
    for _ in range(3):
        sensed = env.step(env.rand_action())["next", "core_orientation"]
        back = Rotation.from_rotvec(np.outer(-faced, (0, 0, 1))) * Rotation.from_matrix(
            matrices(env.state.orientation)
        )
        np.testing.assert_allclose(matrices(sensed), back.as_matrix(), atol=1e-6)
    env.close()


def test_without_a_compass_robots_that_start_with_different_headings_sense_the_same():
    env = LocomotionEnv("gecko", 3, compass=False, seed=0)
    env.reset()
    qpos = env.physics.qpos[:1].repeat(3, 1)
    turns = Rotation.from_rotvec(np.outer([0.0, 1.0, -2.5], (0, 0, 1)))
    turned = turns * Rotation.from_quat(qpos[:, 3:7].numpy(), scalar_first=True)
    qpos[:, 3:7] = torch.from_numpy(turned.as_quat(scalar_first=True))
    env.set_state(qpos, torch.zeros(1, env.model.nv))
    sensed = matrices(env.observe()["core_orientation"])
    np.testing.assert_allclose(sensed, sensed[[0, 0, 0]], atol=1e-6)
    env.close()


def test_a_restored_environment_senses_the_same_headings():
    first = LocomotionEnv("gecko", 3, start="any", compass=False, seed=0)
    other = LocomotionEnv("gecko", 3, start="any", compass=False, seed=1)
    first.reset(), other.reset()
    other.load_state_dict(first.state_dict())
    assert torch.equal(first.observe()["core_orientation"], other.observe()["core_orientation"])
    first.close(), other.close()


def test_dm_control_senses_so_too():
    task = make_task(
        load_robot("gecko"), env=EnvConfig(start=Start.any, compass=False, settle_time=0.0)
    )
    add_observables(task, ["core_orientation"])
    env = composer.Environment(task, random_state=0)
    for _ in range(6):
        sensed = env.reset().observation["core_orientation"][0]
        np.testing.assert_allclose(np.abs(sensed), np.round(np.abs(sensed)), atol=1e-6)


def test_staggered_episodes_end_at_all_times_and_last_as_long_from_then_on():
    env = LocomotionEnv("gecko", 40, time_limit=5.0, stagger=True, settle_time=0.0, seed=0)
    ends = env.rollout(60, break_when_any_done=False)["next", "truncated"].squeeze(-1)
    first = ends.int().argmax(1)
    assert len(first.unique()) > 10
    for robot, begun in zip(ends, first, strict=True):
        assert torch.equal(robot.nonzero().flatten(), torch.arange(begun.item(), 60, 20))
    env.close()
