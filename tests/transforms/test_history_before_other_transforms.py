"""Whatever follows a history finds in it what it would find in CatFrames with its frames flipped."""

import pytest
import torch
from tensordict import TensorDict
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, ReplayBuffer, SliceSampler
from torchrl.envs import (
    CatFrames,
    CatTensors,
    ClipTransform,
    Compose,
    DMControlEnv,
    DoubleToFloat,
    DTypeCastTransform,
    ExcludeTransform,
    FlattenObservation,
    FrameSkipTransform,
    GymEnv,
    InitTracker,
    ObservationNorm,
    RenameTransform,
    RewardSum,
    SelectTransform,
    SerialEnv,
    SignTransform,
    SqueezeTransform,
    StepCounter,
    TimeMaxPool,
    TransformedEnv,
    UnaryTransform,
    UnsqueezeTransform,
    VecNormV2,
)

from locomotion.transforms import HingeHistory, IncludeOrientation, SensorNoise

STEPS = 3
LENGTHS = [3, 4, 7, 1, 50]

#: By name: transforms that read the entry "past", which has six numbers.
FOLLOWING = {
    "nothing": list,
    "ObservationNorm": lambda: [ObservationNorm(0.3, 2.0, ["past"])],
    "ObservationNorm elsewhere": lambda: [ObservationNorm(0.3, 2.0, ["past"], ["scaled"])],
    "VecNormV2": lambda: [VecNormV2(["past"])],
    "CatTensors": lambda: [CatTensors(["past", "speed"], "all")],
    "CatTensors that keeps": lambda: [CatTensors(["past", "speed"], "all", del_keys=False)],
    "RenameTransform": lambda: [RenameTransform(["past"], ["renamed"])],
    "RenameTransform of a copy": lambda: [RenameTransform(["past"], ["renamed"], create_copy=True)],
    "SelectTransform": lambda: [SelectTransform("past")],
    "SelectTransform of others": lambda: [SelectTransform("speed")],
    "ExcludeTransform": lambda: [ExcludeTransform("past")],
    "ExcludeTransform of others": lambda: [ExcludeTransform("angle", "speed")],
    "DoubleToFloat": lambda: [DoubleToFloat(["past"])],
    "DTypeCastTransform": lambda: [DTypeCastTransform(torch.float64, torch.float16, ["past"])],
    "UnsqueezeTransform": lambda: [UnsqueezeTransform(-1, in_keys=["past"])],
    "SqueezeTransform": lambda: [
        UnsqueezeTransform(-1, in_keys=["past"]),
        SqueezeTransform(-1, in_keys=["past"]),
    ],
    "FlattenObservation": lambda: [
        UnsqueezeTransform(-1, in_keys=["past"]),
        FlattenObservation(-2, -1, in_keys=["past"]),
    ],
    "ClipTransform": lambda: [ClipTransform(["past"], low=-2.0, high=3.0)],
    "SignTransform": lambda: [SignTransform(["past"])],
    "UnaryTransform": lambda: [UnaryTransform(["past"], ["past"], fn=lambda x: x.cumsum(-1))],
    "CatFrames": lambda: [CatFrames(2, -1, ["past"])],
    "TimeMaxPool": lambda: [TimeMaxPool(["past"], T=2)],
    "FrameSkipTransform": lambda: [FrameSkipTransform(2)],
    "what counts": lambda: [StepCounter(), RewardSum(), InitTracker()],
    "HingeHistory": lambda: [HingeHistory(2, "past")],
    "HingeHistory in place": lambda: [HingeHistory(2, "past", "past")],
    "IncludeOrientation": lambda: [IncludeOrientation("yaw", ["past"], part=slice(1, 5))],
    "SensorNoise": lambda: [SensorNoise(0.1, "past")],
    "SensorNoise and HingeHistory": lambda: [SensorNoise(0.1, "past"), HingeHistory(2, "past")],
    "several": lambda: [
        ObservationNorm(0.3, 2.0, ["past"]),
        CatTensors(["past", "speed"], "all"),
        VecNormV2(["all"]),
        DoubleToFloat(["all"]),
        RenameTransform(["all"], ["seen"]),
    ],
}


def flipped_frames(source="angle"):
    """The history by stock transforms alone."""
    return [
        CatFrames(STEPS, -1, [source], ["past"], padding="constant"),
        UnaryTransform(
            ["past"], ["past"], fn=lambda x: x.unflatten(-1, (STEPS, -1)).flip(-2).flatten(-2)
        ),
    ]


def specified(env):
    """The environment with its specs, for which UnaryTransform draws random numbers."""
    assert env.output_spec is not None
    return env


def assert_same(found, expected):
    keys = set(expected.keys(True, True))
    assert set(found.keys(True, True)) == keys
    for key in keys:
        assert found[key].dtype == expected[key].dtype, key
        torch.testing.assert_close(found[key], expected[key], rtol=0, atol=0, equal_nan=True)


@pytest.fixture
def both(counting_env):
    """Makes two environments: with the history, and with the flipped frames."""

    def make(following):
        return [
            specified(TransformedEnv(counting_env(LENGTHS), Compose(*past, *following())))
            for past in ([HingeHistory(STEPS, "angle", "past")], flipped_frames())
        ]

    return make


# TorchRL finds its own VecNormV2 experimental for environments with a batch.
pytestmark = pytest.mark.filterwarnings("ignore:Support of VecNormV2")


@pytest.mark.parametrize("name", FOLLOWING)
def test_rollouts_with_robots_that_are_reset_alone_are_the_same(both, name):
    rollouts = []
    for env in both(FOLLOWING[name]):
        torch.manual_seed(0)
        rollouts.append(env.rollout(20, break_when_any_done=False))
    assert rollouts[0]["next", "done"].sum() > 20
    assert_same(*rollouts)


# StepCounter and RewardSum count on from what they are given.
@pytest.mark.parametrize("name", sorted(FOLLOWING.keys() - {"what counts"}))
def test_steps_with_the_action_alone_are_the_same(both, name):
    seen = []
    for env in both(FOLLOWING[name]):
        torch.manual_seed(0)
        seen.append([env.reset().clone()])
        for _ in range(5):
            action = TensorDict({"action": torch.zeros(len(LENGTHS), 1)}, [len(LENGTHS)])
            seen[-1].append(env.step(action)["next"].clone())
    for found, expected in zip(*seen):
        assert_same(found, expected)


def test_a_reset_of_chosen_robots_is_the_same(both):
    chosen = torch.tensor([True, False, False, True, False])[:, None]
    found, expected = [], []
    for env, results in zip(both(list), (found, expected)):
        torch.manual_seed(0)
        results.append(env.rollout(6, break_when_any_done=False))
        last = results[0][:, -1]["next"].clone()
        results.append(env.reset(last.set("_reset", chosen)))
        results.append(env.step(env.rand_action(results[-1]))["next"])
    for one, other in zip(found, expected):
        assert_same(one, other)
    assert torch.equal((found[1]["past"][:, 2:] == 0).all(-1, keepdim=True), chosen)


@pytest.mark.parametrize("before", ["ObservationNorm", "SensorNoise", "IncludeOrientation"])
def test_a_history_remembers_what_transforms_before_it_wrote(counting_env, before):
    source, make = {
        "ObservationNorm": ("scaled", lambda: ObservationNorm(0.3, 2.0, ["angle"], ["scaled"])),
        "SensorNoise": ("speed", lambda: SensorNoise(0.1, "speed")),
        "IncludeOrientation": (
            "orientation",
            lambda: Compose(
                CatTensors(["angle", "speed"], "all", del_keys=False),
                IncludeOrientation("gravity", ["all"], part=slice(0, 4)),
            ),
        ),
    }[before]
    rollouts = []
    for past in ([HingeHistory(STEPS, source, "past")], flipped_frames(source)):
        env = specified(TransformedEnv(counting_env(LENGTHS), Compose(make(), *past)))
        torch.manual_seed(0)
        rollouts.append(env.rollout(12, break_when_any_done=False))
    assert_same(*rollouts)


def test_around_a_batched_environment_it_is_the_same(counting_env):
    rollouts = []
    for past in ([HingeHistory(STEPS, "angle", "past")], flipped_frames()):
        inner = SerialEnv(2, [lambda n=n: counting_env([n, n + 2]) for n in (2, 5)])
        following = ObservationNorm(0.3, 2.0, ["past"])
        env = specified(TransformedEnv(inner, Compose(*past, following)))
        torch.manual_seed(0)
        rollouts.append(env.rollout(12, break_when_any_done=False))
    assert rollouts[0].shape == (2, 2, 12)
    assert_same(*rollouts)


def test_in_a_replay_buffer_it_is_the_same(counting_env):
    env = TransformedEnv(counting_env([4] * 3), InitTracker())
    rollout = env.rollout(12, break_when_any_done=False)
    keys = ["angle", ("next", "angle")], ["past", ("next", "past")]
    stacked = CatFrames(STEPS, -1, *keys, padding="constant")
    flip = UnaryTransform(
        keys[1], keys[1], fn=lambda x: x.unflatten(-1, (STEPS, -1)).flip(-2).flatten(-2)
    )
    samples = []
    for past in ([HingeHistory(STEPS, "angle", "past")], [stacked, flip]):
        torch.manual_seed(0)
        buffer = ReplayBuffer(
            storage=LazyTensorStorage(36),
            sampler=SliceSampler(slice_len=4, end_key=("next", "done"), strict_length=True),
            batch_size=24,
        )
        buffer.append_transform(lambda td: td.reshape(-1, 4).refine_names(None, "time"))
        for transform in (*past, ObservationNorm(0.3, 2.0, ["past"])):
            buffer.append_transform(transform)
        buffer.extend(rollout.reshape(-1))
        samples.append(buffer.sample())
    assert_same(*samples)


#: Environments of others, with the entry that is remembered.
ELSEWHERE = {
    "Gymnasium": ("observation", lambda: TransformedEnv(GymEnv("Pendulum-v1"), StepCounter(7))),
    "dm-control": (
        "velocity",
        lambda: TransformedEnv(DMControlEnv("cartpole", "balance"), StepCounter(7)),
    ),
    "several of Gymnasium's": (
        "observation",
        lambda: SerialEnv(2, lambda: TransformedEnv(GymEnv("Pendulum-v1"), StepCounter(7))),
    ),
}


@pytest.mark.parametrize("collected", [False, True])
@pytest.mark.parametrize("name", ELSEWHERE)
def test_in_environments_of_others_it_is_the_same(name, collected):
    source, make = ELSEWHERE[name]
    found = []
    for past in ([HingeHistory(STEPS, source, "past")], flipped_frames(source)):
        chain = Compose(*past, CatTensors(["past", source], "all"))
        env = specified(TransformedEnv(make(), chain, auto_unwrap=False))
        env.set_seed(0)
        torch.manual_seed(0)
        if collected:
            collector = Collector(env, None, frames_per_batch=40, total_frames=40)
            found.append(next(iter(collector)).exclude("collector"))
            collector.shutdown()
        else:
            found.append(env.rollout(20, break_when_any_done=False))
            env.close()
    assert found[0]["next", "done"].any()
    assert_same(*found)


def test_for_agents_that_are_reset_together_it_is_the_same(agents_env):
    keys = [("agents", "angle")], [("agents", "past")]
    flip = UnaryTransform(
        keys[1], keys[1], fn=lambda x: x.unflatten(-1, (STEPS, -1)).flip(-2).flatten(-2)
    )
    frames = CatFrames(STEPS, -1, *keys, padding="constant", reset_key="_reset")
    rollouts = []
    for past in ([HingeHistory(STEPS, *keys)], [frames, flip]):
        env = agents_env([[2, 3, 9], [4, 1, 3]], together=True)
        norm = ObservationNorm(0.3, 2.0, [("agents", "past")])
        env = specified(TransformedEnv(env, Compose(*past, norm)))
        torch.manual_seed(0)
        rollouts.append(env.rollout(15, break_when_any_done=False))
    assert rollouts[0]["next", "done"].sum() > 4
    assert_same(*rollouts)
