"""The transforms in environments that are not ours, against references that are not ours."""

import mujoco
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation
from tensordict import TensorDict
from torchrl.data import LazyTensorStorage, ReplayBuffer, SliceSampler
from torchrl.envs import (
    Compose,
    GymEnv,
    ParallelEnv,
    PendulumEnv,
    SerialEnv,
    StepCounter,
    TransformedEnv,
    UnsqueezeTransform,
    check_env_specs,
)

from locomotion.transforms import HingeHistory, IncludeOrientation


def pendulum(batch=()):
    env = TransformedEnv(PendulumEnv(batch_size=batch) if batch else PendulumEnv())
    env.append_transform(UnsqueezeTransform(-1, in_keys=["th"], out_keys=["angle"]))
    return env


def pendulum_with_history(steps=3, max_steps=None):
    env = pendulum().append_transform(HingeHistory(steps, in_keys=["angle"]))
    return env if max_steps is None else env.append_transform(StepCounter(max_steps))


def ant_with_orientation():
    # Gymnasium's Ant observes its height and then the quaternion w x y z of its torso.
    return TransformedEnv(
        GymEnv("Ant-v5"), IncludeOrientation("gravity", in_keys=["observation"], part=slice(1, 5))
    )


def histories(values, starts, steps):
    """The definition, element by element: value at t - k, or zero before the episode's start."""
    batch, time, size = values.shape
    expected = torch.zeros(batch, time, steps, size, dtype=values.dtype)
    for row in range(batch):
        first = 0
        for t in range(time):
            first = t if starts[row, t] else first
            for k in range(min(steps, t - first + 1)):
                expected[row, t, k] = values[row, t - k]
    return expected.flatten(-2)


@pytest.mark.parametrize("steps", [1, 2, 5])
def test_history_is_newest_first_with_zeros_before_the_start(steps):
    rollout = pendulum_with_history(steps).rollout(8)[None]
    starts = torch.arange(8).eq(0)[None]
    expected = histories(rollout["angle"], starts, steps)
    assert torch.equal(rollout["angle_history"], expected)
    assert torch.equal(rollout["next", "angle_history"][:, :-1], expected[:, 1:])


def test_history_starts_anew_where_single_robots_are_reset():
    lengths = iter((3, 4, 7))
    env = SerialEnv(3, [lambda n=n: pendulum_with_history(3, n) for n in lengths])
    rollout = env.rollout(20, break_when_any_done=False)
    starts = rollout["step_count"].squeeze(-1) == 0
    assert starts.sum() > 8
    assert torch.equal(rollout["angle_history"], histories(rollout["angle"], starts, 3))


def test_history_outside_the_batched_environment_sees_partial_resets_too():
    lengths = iter((3, 4, 7))
    inner = SerialEnv(3, [lambda n=n: pendulum().append_transform(StepCounter(n)) for n in lengths])
    env = TransformedEnv(inner, HingeHistory(3, in_keys=["angle"]))
    rollout = env.rollout(20, break_when_any_done=False)
    starts = rollout["step_count"].squeeze(-1) == 0
    assert torch.equal(rollout["angle_history"], histories(rollout["angle"], starts, 3))


@pytest.mark.parametrize("batched", [SerialEnv, ParallelEnv])
def test_specs_hold_inside_and_outside_batched_environments(batched):
    check_env_specs(pendulum_with_history())
    check_env_specs(ant_with_orientation())
    for env in (
        batched(2, pendulum_with_history),
        TransformedEnv(batched(2, pendulum), HingeHistory(2, in_keys=["angle"])),
    ):
        check_env_specs(env)
        env.close()


def test_replay_buffer_rebuilds_the_history_of_whole_episodes():
    env = pendulum_with_history(3, max_steps=5)
    rollout = env.rollout(20, break_when_any_done=False)
    buffer = ReplayBuffer(
        storage=LazyTensorStorage(20),
        sampler=SliceSampler(slice_len=5, end_key=("next", "done"), strict_length=True),
        batch_size=20,
        transform=Compose(
            lambda td: td.reshape(-1, 5).refine_names(None, "time"),
            HingeHistory(3, in_keys=["angle"], out_keys=["rebuilt"]),
        ),
    )
    buffer.extend(rollout)
    sample = buffer.sample()
    assert torch.equal(sample["rebuilt"], sample["angle_history"])
    assert torch.equal(sample["next", "rebuilt"], sample["next", "angle_history"])


def test_history_needs_a_positive_length_and_matching_keys():
    with pytest.raises(ValueError, match="steps must be at least 1"):
        HingeHistory(0)
    with pytest.raises(ValueError, match="2 in_keys but 1 out_keys"):
        HingeHistory(2, in_keys=["a", "b"], out_keys=["c"])


unit_quaternions = arrays(np.float64, (5, 4), elements=st.floats(-1, 1)).filter(
    lambda q: (np.linalg.norm(q, axis=-1) > 0.1).all()
)


@settings(deadline=None)
@given(unit_quaternions)
def test_orientations_agree_with_scipy(quaternion):
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


def test_orientation_of_a_gymnasium_robot_is_its_mujoco_pose():
    env = ant_with_orientation()
    env.reset()
    for _ in range(10):
        td = env.rand_step()
    gym = env.unwrapped
    mujoco.mj_kinematics(gym.model, gym.data)
    torso = gym.data.body("torso").xmat.reshape(3, 3)
    np.testing.assert_allclose(td["next", "orientation"], -torso[2], atol=1e-6)


def test_mistakes_about_orientation_are_named():
    with pytest.raises(ValueError, match="'euler' must be one of quaternion, rotation_6d"):
        IncludeOrientation("euler")
    env = TransformedEnv(GymEnv("Ant-v5"), IncludeOrientation(in_keys=["observation"]))
    with pytest.raises(ValueError, match="'observation' holds 105 numbers, a quaternion takes 4"):
        _ = env.observation_spec
