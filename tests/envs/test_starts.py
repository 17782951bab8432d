"""Starts with any heading, upright or overturned."""

import math

import mujoco
import numpy as np
import pytest
import torch
from dm_control import composer

from locomotion.envs import LocomotionEnv
from locomotion.envs.making import make_task
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
