"""Each reading against MuJoCo, stepped in parallel, or a closed form."""

import math

import mujoco
import numpy as np
import pytest
import torch
from dm_control import composer
from torchrl.envs import check_env_specs

from locomotion.envs import LocomotionEnv
from locomotion.options import readings

ALL = readings.names()
#: Warp computes in float32, and a gait in contact feels the last digit.
CLOSE = {"threaded": 1e-6, "warp": 2e-3}


class Beside:
    """One robot in MuJoCo, and what its sensors would say."""

    def __init__(self, env, robot):
        self.env, self.robot = env, robot
        self.model = env.model
        self.data = mujoco.MjData(self.model)
        self.core = f"{env.task.robot.mjcf_model.model}/"

    def follow(self):
        """Goes where the robot of the environment is."""
        self.data.qpos[:] = self.env.physics.qpos[self.robot].cpu()
        self.data.qvel[:] = self.env.physics.qvel[self.robot].cpu()

    def step(self, target, num_steps):
        self.data.ctrl[:] = target
        mujoco.mj_step(self.model, self.data, num_steps)

    def readings(self):
        touched = self._touched()  # as of the last physics step, like torques
        servos = [self.data.actuator(f"{self.core}{hinge}/servo") for hinge in self.env.hinge_names]
        torque = np.ravel([servo.force for servo in servos])
        mujoco.mj_forward(self.model, self.data)
        joints = [self.data.joint(f"{self.core}{hinge}/hinge") for hinge in self.env.hinge_names]
        body, velocity = self.data.body(self.core), np.zeros(6)
        mujoco.mj_objectVelocity(
            self.model, self.data, mujoco.mjtObj.mjOBJ_XBODY, body.id, velocity, True
        )
        return {
            "hinge_position": np.ravel([joint.qpos for joint in joints]),
            "hinge_velocity": np.ravel([joint.qvel for joint in joints]),
            "hinge_torque": torque,
            "hinge_target": np.clip(self.data.ctrl, -1, 1),
            "core_orientation": body.xquat,
            "core_angular_velocity": velocity[:3],
            "core_linear_velocity": velocity[3:],
            "core_height": body.xpos[2:],
            "core_position": body.xpos,
            "ground_contact": np.array([path in touched for path in self.env.task.robot.modules]),
        }

    def _touched(self):
        found = set()
        for contact in self.data.contact:
            names = [self.model.geom(geom).name for geom in contact.geom]
            if "ground" in names:
                (geom,) = (name for name in names if name != "ground")
                found.add(geom.removeprefix(self.core).rpartition("/")[0])
        return found


def agree(found, expected, robot, off):
    for name, value in expected.items():
        np.testing.assert_allclose(
            found[name][robot].cpu(), value, atol=off, rtol=off, err_msg=name
        )


@pytest.mark.parametrize("robot", ["gecko", "ant"])
def test_readings_are_what_mujoco_says(robot, make, stepping):
    env = make(3, robot, readings=ALL, physics={"self_collision": robot == "ant"})
    found, off = env.reset(), CLOSE[stepping["backend"]]
    beside = [Beside(env, row) for row in range(3)]
    touching, generator = [], torch.Generator().manual_seed(0)
    for _ in range(8):
        for one in beside:
            one.follow()
        action = 3 * torch.rand(3, env.model.nu, generator=generator) - 1.5  # beyond the limits
        found = env.step(found.set("action", action.to(env.physics.device)))["next"]
        for row, one in enumerate(beside):
            one.step(action[row], 25)
            agree(found, one.readings(), row, off)
        touching.append(found["ground_contact"].cpu())
    share = torch.stack(touching).mean()
    assert 0 < share < 1  # some touch the ground, some do not


def test_after_a_reset_readings_are_of_the_physics_step_that_it_ended_with(make, stepping):
    env = make(2, readings=ALL)
    env.rollout(2)
    found, expected = env.reset(), Beside(env, 1)
    expected.step(env.physics.control[1].cpu(), 25)  # 0.5 s of settling, ended with the same state
    expected.step(env.physics.control[1].cpu(), 25)
    off = {"threaded": 1e-6, "warp": 0.1}[
        stepping["backend"]
    ]  # corners that all touch at the start
    agree(found, expected.readings(), 1, off)


def test_without_settling_readings_are_of_robots_that_stand(make):
    env = make(2, readings=ALL, settle_time=0.0)
    td = env.reset()
    env.step(td.set("action", torch.ones_like(env.physics.control)))
    found = env.reset()
    for name in ALL:
        if name.startswith("hinge") or name.endswith("velocity"):
            assert not found[name].any(), name
    assert torch.equal(found["phase_clock"].cpu(), torch.tensor([[1.0, 0.0]] * 2))


def test_the_ground_is_felt_by_the_modules_that_touch_it(make):
    """A robot in the air, and one that stands."""
    env = make(2, readings=["ground_contact"], settle_time=0.0)
    env.reset()
    qpos = torch.as_tensor(env.model.qpos0).repeat(2, 1)
    qpos[0, 2] += 1.0
    qpos[1, 2] -= 1e-3
    env.set_state(qpos, torch.zeros(2, env.model.nv))
    td = env.fake_tensordict()
    td["action"].zero_()
    air, ground = env.step(td)["next", "ground_contact"].cpu()
    assert not air.any()
    kinds = [module.kind for module in env.task.robot.body.walk()]
    paths = [module.path for module in env.task.robot.body.walk()]
    felt = dict(zip(env.task.robot.modules, ground.tolist()))
    # Cores and bricks are equally high, hinges are not.
    assert [felt[path] for path in paths] == [float(kind != "hinge") for kind in kinds]


@pytest.mark.parametrize(("frequency", "settle_time"), [(1.0, 0.5), (0.3, 0.0), (0.3, 0.333)])
def test_the_phase_clock_starts_with_each_episode(frequency, settle_time, make):
    env = make(3, readings=["phase_clock"], clock_frequency=frequency, settle_time=settle_time)

    def clock(steps):
        angle = 2 * math.pi * frequency * torch.tensor(steps, dtype=torch.float64) / 4
        return torch.stack([angle.cos(), angle.sin()], -1).float()

    td, period = env.reset(), torch.zeros_like(env.physics.control)
    torch.testing.assert_close(td["phase_clock"].cpu(), clock([0, 0, 0]), atol=1e-6, rtol=0)
    for _ in range(3):
        td = env.step(td.set("action", period))["next"]
    torch.testing.assert_close(td["phase_clock"].cpu(), clock([3, 3, 3]), atol=1e-6, rtol=0)
    where = torch.tensor([[False], [True], [False]], device=env.physics.device)
    td = env.reset(td.set("_reset", where))
    torch.testing.assert_close(td["phase_clock"].cpu(), clock([3, 0, 3]), atol=1e-6, rtol=0)
    td = env.step(td.set("action", period))["next"]
    torch.testing.assert_close(td["phase_clock"].cpu(), clock([4, 1, 4]), atol=1e-6, rtol=0)
    env.set_state(env.physics.qpos[:1].clone(), env.physics.qvel[:1].clone(), where[:, 0])
    td = env.step(td.set("action", period))["next"]
    torch.testing.assert_close(td["phase_clock"].cpu(), clock([5, 1, 5]), atol=1e-6, rtol=0)


def test_a_partial_reset_leaves_the_readings_of_others_alone(make):
    env = make(3, readings=ALL)
    td = env.rollout(3)[:, -1]["next"]
    where = torch.tensor([[False], [True], [False]], device=env.physics.device)
    fresh = env.reset(td.clone().set("_reset", where))
    now = env.observe()
    for name in ALL:
        for robot in (0, 2):
            assert torch.equal(fresh[name][robot], td[name][robot]), name
            assert torch.equal(now[name][robot], td[name][robot]), name


@pytest.mark.parametrize("robot", ["gecko", "ant"])
@pytest.mark.parametrize(("latency", "settle_time"), [(0.0, 0.5), (0.1, 0.0)])
def test_dm_controls_observables_are_the_same(robot, latency, settle_time):
    late = {"latency": latency}
    env = LocomotionEnv(robot, 2, readings=ALL, disturbances=late, settle_time=settle_time)
    reference = composer.Environment(env.task, random_state=0)
    assert set(reference.observation_spec()) == set(ALL)
    reference.reset()
    data, rng = reference.physics.data, np.random.default_rng(0)
    env.set_state(torch.tensor(data.qpos), torch.tensor(data.qvel))
    td = env.fake_tensordict()
    for _ in range(8):
        action = rng.uniform(-1.5, 1.5, env.model.nu)
        expected = reference.step(action).observation
        td["action"] = torch.as_tensor(action).expand(2, -1)
        found = env.step(td)["next"]
        for name in ALL:
            np.testing.assert_allclose(
                found[name][1], expected[name][0], atol=1e-6, rtol=0, err_msg=name
            )


def test_specs_hold_with_all_readings(make):
    env = make(3, readings=ALL)
    check_env_specs(env)
    assert set(env.observation_spec.keys()) == set(ALL)
    for name in ALL:
        assert env.observation_spec[name].shape[-1] == readings.get(name).size(env.task)
