"""Representations of an orientation, against scipy and MuJoCo."""

import mujoco
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation
from tensordict import TensorDict
from torchrl.envs import GymEnv, SerialEnv, StepCounter, TransformedEnv, check_env_specs

from locomotion.transforms import IncludeOrientation


def ant_with_orientation():
    # Gymnasium's Ant observes its height and then the quaternion w x y z of its torso.
    return TransformedEnv(
        GymEnv("Ant-v5"), IncludeOrientation("gravity", in_keys=["observation"], part=slice(1, 5))
    )


unit_quaternions = arrays(np.float64, (5, 4), elements=st.floats(-1, 1)).filter(
    lambda q: (np.linalg.norm(q, axis=-1) > 0.1).all()
)


@settings(deadline=None)
@given(unit_quaternions)
def test_representations_agree_with_scipy(quaternion):
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    rotation = Rotation.from_quat(quaternion, scalar_first=True)
    matrix = rotation.as_matrix()
    forward = rotation.apply([1.0, 0.0, 0.0])
    expected = {
        "quaternion": quaternion,
        "rotation_6d": np.concatenate([matrix[:, :, 0], matrix[:, :, 1]], -1),
        "gravity": rotation.apply([0.0, 0.0, -1.0], inverse=True),
        "yaw": np.arctan2(forward[:, 1], forward[:, 0])[:, None],
    }
    td = TensorDict({"pose": torch.as_tensor(np.pad(quaternion, ((0, 0), (2, 1))))}, [5])
    for representation, value in expected.items():
        transform = IncludeOrientation(
            representation, in_keys=["pose"], out_keys=["seen"], part=slice(2, 6)
        )
        seen = transform(td.clone())["seen"].numpy()
        difference = seen - value
        if representation == "yaw":
            if np.hypot(forward[:, 0], forward[:, 1]).min() < 1e-6:
                continue  # no heading: the body's x axis points up or down
            difference = (difference + np.pi) % (2 * np.pi) - np.pi
        np.testing.assert_allclose(difference, 0, atol=1e-9)


def test_that_of_a_gymnasium_robot_is_its_mujoco_pose():
    env = ant_with_orientation()
    env.reset()
    for _ in range(10):
        td = env.rand_step()
    gym = env.unwrapped
    mujoco.mj_kinematics(gym.model, gym.data)
    torso = gym.data.body("torso").xmat.reshape(3, 3)
    np.testing.assert_allclose(td["next", "orientation"], -torso[2], atol=1e-6)


@pytest.mark.parametrize("representation", ["quaternion", "rotation_6d", "gravity", "yaw"])
def test_specs_hold(representation):
    parts = {"in_keys": ["observation"], "part": slice(1, 5)}
    env = GymEnv("Ant-v5")
    check_env_specs(TransformedEnv(env, IncludeOrientation(representation, **parts)))


def test_specs_hold_inside_and_outside_a_batched_environment():
    check_env_specs(SerialEnv(2, ant_with_orientation))
    parts = {"in_keys": ["observation"], "part": slice(1, 5)}
    batched = SerialEnv(2, lambda: GymEnv("Ant-v5"))
    check_env_specs(TransformedEnv(batched, IncludeOrientation("yaw", **parts)))


def test_the_entry_that_is_read_stays_as_it_was():
    td = TensorDict({"core_orientation": torch.tensor([[1.0, 0.0, 0.0, 0.0]])}, [1])
    IncludeOrientation()(td)["orientation"].zero_()
    assert torch.equal(td["core_orientation"], torch.tensor([[1.0, 0.0, 0.0, 0.0]]))


@pytest.mark.parametrize("representation", ["euler", None, ["yaw"], 3])
def test_an_unknown_representation_is_named_with_those_there_are(representation):
    with pytest.raises(ValueError, match="must be one of quaternion, rotation_6d, gravity, yaw"):
        IncludeOrientation(representation)


@pytest.mark.parametrize("part", [3, (1, 5), "1:5"])
def test_a_part_that_is_no_slice_is_named(part):
    with pytest.raises(ValueError, match="part must be a slice, such as slice"):
        IncludeOrientation(part=part)


def test_mistakes_are_named(counting_env):
    with pytest.raises(ValueError, match="got 2 in_keys but 1 out_keys"):
        IncludeOrientation(in_keys=["a", "b"])
    with pytest.raises(ValueError, match="'observation' holds 105 numbers, a quaternion takes 4"):
        TransformedEnv(GymEnv("Ant-v5"), IncludeOrientation(in_keys=["observation"]))
    with pytest.raises(ValueError, match="'speed' holds 3 numbers, a quaternion takes 4"):
        TransformedEnv(counting_env([3]), IncludeOrientation(in_keys="speed"))
    with pytest.raises(ValueError, match="holds 3 numbers, a quaternion takes 4"):
        IncludeOrientation("yaw", "speed")(TensorDict({"speed": torch.zeros(2, 3)}, [2]))
    env = TransformedEnv(counting_env([3]), StepCounter())
    with pytest.raises(ValueError, match="holds torch.int64, not floating point numbers"):
        env.append_transform(IncludeOrientation("yaw", "step_count"))
