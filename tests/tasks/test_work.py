"""The work of hinges, against the integral of torque times speed in MuJoCo stepped by hand."""

import mujoco
import numpy as np
import pytest
import torch

from locomotion.envs import LocomotionEnv, make_task
from locomotion.physics.options import PhysicsConfig
from locomotion.robots import ModularRobot, load_robot
from locomotion.tasks import WalkAway, compile_model
from locomotion.tasks.rewards import Work

CONTROL_STEPS = 4


@pytest.fixture(scope="module")
def actions():
    """Targets so far apart that torques reach their limit, and so small that no hinge does."""
    return np.random.default_rng(0).choice([-0.6, -0.5, 0.2, 0.5, 0.6], (CONTROL_STEPS, 6))


@pytest.fixture(scope="module")
def make():
    def make(timestep, **stepping):
        robot = ModularRobot(load_robot("gecko").body, "gecko")
        task = WalkAway(robot, rewards=[Work(weight=1.0)], physics_timestep=timestep)
        return LocomotionEnv(task, 2, physics=stepping)

    return make


def high_up(model):
    qpos = model.qpos0.copy()
    qpos[2] = 8.0  # it falls all the while, so that all timesteps come to the same movements
    return qpos


def integral(model, actions, torques):
    """Work in each control step (J), in MuJoCo stepped by hand.

    Args:
        torques: of all hinges in the physics step that a model and its data have just taken from a
            position and velocity.
    """
    data, work = mujoco.MjData(model), np.zeros(CONTROL_STEPS)
    data.qpos[:] = high_up(model)
    for step, action in enumerate(actions):
        data.ctrl[:] = action
        for _ in range(round(0.25 / model.opt.timestep)):
            before = data.qpos.copy(), data.qvel.copy()
            mujoco.mj_step(model, data)
            speed = (before[1] + data.qvel)[6:] / 2
            work[step] += abs(torques(model, data, before) * speed).sum() * model.opt.timestep
    return work


def needed(model, data, before):
    """The torques that it took, by MuJoCo's inverse dynamics."""
    start = mujoco.MjData(model)
    start.qpos[:], start.qvel[:] = before
    start.qacc[:] = (data.qvel - before[1]) / model.opt.timestep
    mujoco.mj_inverse(model, start)
    return start.qfrc_inverse[6:]


def exerted(model, data, before):
    """The torques that the servos say they exert."""
    return data.actuator_force


@pytest.fixture(scope="module")
def exact(make, actions):
    """Work in each control step (J), with a hundredth of the timestep."""
    return integral(make(1e-4).model, actions, exerted)


@pytest.mark.parametrize("timestep", [0.01, 0.005, 0.001])
def test_it_is_the_integral_whatever_the_timestep(timestep, make, actions, exact, stepping):
    env = make(timestep, **stepping)
    env.set_state(torch.as_tensor(high_up(env.model)), torch.zeros(env.model.nv))
    td, work = env.fake_tensordict(), []
    for action in actions:
        action = torch.as_tensor(action, dtype=torch.float32).to(env.physics.device)
        td = env.step(td.set("action", action.expand(2, -1)))["next"]
        work.append(td["reward"][1].item())
    np.testing.assert_allclose(work, integral(env.model, actions, needed), rtol=1e-4)
    np.testing.assert_allclose(work, exact, rtol=6 * timestep + 2e-3)
    assert min(work) > 0.1


def test_work_is_that_of_servos_as_each_robot_has_them(make, actions, stepping):
    """Some of the torques are at the limit, which is a robot's own too."""
    env, physics = make(0.01, **stepping), {"stiffness": 0.6, "damping": 0.72}
    weak = make_task(load_robot("gecko"), physics=PhysicsConfig(**physics))
    weak = compile_model(weak, sensors=False)
    weak.actuator_forcerange *= 0.6
    for name in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange"):
        own = env.physics.expand(name)
        own[1] = torch.as_tensor(getattr(weak, name)).to(own).reshape(own[1].shape)
    env.set_state(torch.as_tensor(high_up(env.model)), torch.zeros(env.model.nv))
    td, work, walked = env.fake_tensordict(), [], []
    for action in actions:
        action = torch.as_tensor(action, dtype=torch.float32).to(env.physics.device)
        sums = torch.zeros(2, dtype=torch.float64, device=env.physics.device)
        with env.after_substep(lambda physics, sums=sums: sums.add_(physics.hinge_work())):
            td = env.step(td.set("action", action.expand(2, -1)))["next"]
        work.append(td["reward"].squeeze(-1).tolist())
        walked.append(sums.tolist())
    np.testing.assert_allclose(walked, work, rtol=1e-6)
    for robot, model in enumerate((env.model, weak)):
        expected = integral(model, actions, needed)
        np.testing.assert_allclose([each[robot] for each in work], expected, rtol=1e-4)
    assert abs(work[0][0] - work[0][1]) > 0.05 * work[0][0]


def test_hinges_that_are_held_do_no_work(make):
    env = make(0.01)
    env.set_state(torch.as_tensor(high_up(env.model)), torch.zeros(env.model.nv))
    td = env.fake_tensordict()
    td = env.step(td.set("action", torch.zeros(2, 6)))["next"]
    assert td["reward"].abs().max() < 1e-3
