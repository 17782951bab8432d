import mujoco
import numpy as np
import pytest
import torch

from locomotion.disturbances import DisturbancesConfig
from locomotion.envs import make_task
from locomotion.options import typed
from locomotion.physics import make_physics
from locomotion.physics.options import PhysicsConfig
from locomotion.robots import load_robot
from locomotion.tasks import compile_model


@pytest.fixture(scope="session")
def make(stepping):
    """Makes the physics of a robot with the keys of ``physics`` that are given.

    ``latency`` is what there is room for; masses and torques are scaled by hand.
    """

    def make(num_envs, robot="gecko", latency=0.0, mass=1.0, strength=1.0, **options):
        config = typed(PhysicsConfig, {**stepping, **options})
        late = DisturbancesConfig(latency=latency)
        task = make_task(load_robot(robot), physics=config, disturbances=late)
        model = compile_model(task, sensors=False)
        for array in (model.body_mass, model.body_inertia):
            array *= mass
        for array in (model.actuator_gainprm, model.actuator_biasprm, model.actuator_forcerange):
            array *= strength
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return make_physics(model, num_envs, config)

    return make


@pytest.fixture(scope="session")
def fly():
    """Puts all copies high into the air, where nothing touches for a second, and into motion."""

    def fly(physics):
        generator = torch.Generator().manual_seed(0)
        physics.qpos[:] = torch.as_tensor(physics.model.qpos0)
        physics.qpos[:, 2] = 8.0
        speeds = torch.rand(physics.qvel.shape, generator=generator, dtype=torch.float64) - 0.5
        physics.qvel[:] = speeds.to(physics.device)

    return fly


@pytest.fixture(scope="session")
def by_hand():
    """MuJoCo, stepped one copy and one physics step at a time.

    Called with a model, a position and a velocity to start from, and the controls of all physics
    steps; returns position and velocity at the end.
    """

    def by_hand(model, qpos, qvel, controls):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = qpos.cpu(), qvel.cpu()
        for control in controls:
            data.ctrl[:] = control
            mujoco.mj_step(model, data)
        return torch.as_tensor(data.qpos), torch.as_tensor(data.qvel)

    return by_hand


@pytest.fixture(scope="session")
def same(stepping):
    """Compares a state with MuJoCo's: bit for bit, but for Warp, which computes in float32."""

    def same(physics, copy, expected, rounding=0.0):
        qpos, qvel = 3e-5, 1e-3
        if stepping["backend"] == "threaded":
            qpos = qvel = rounding
        for found, wanted, off in zip((physics.qpos, physics.qvel), expected, (qpos, qvel)):
            np.testing.assert_allclose(found[copy].cpu(), wanted, atol=off, rtol=0)

    return same
