"""A state that was saved leads to the same future, whatever transforms there are."""

import io
from itertools import islice

import pytest
import torch
from tensordict import TensorDict
from torchrl.collectors import Collector
from torchrl.data import Composite, Unbounded
from torchrl.envs import (
    CatFrames,
    Compose,
    EnvBase,
    InitTracker,
    ObservationNorm,
    RandomTruncationTransform,
    RewardScaling,
    RewardSum,
    StepCounter,
    TensorDictPrimer,
    TimeMaxPool,
    TransformedEnv,
    VecNormV2,
)

from locomotion.envs import LocomotionEnv, ResumableEnv
from locomotion.transforms import HingeHistory, IncludeOrientation, SensorNoise

HINGES = ["hinge_position"]

#: By name: stock transforms with a memory of some kind, and ours.
TRANSFORMS = {
    "none": list,
    "HingeHistory": lambda: [HingeHistory(3)],
    "HingeHistory in place": lambda: [HingeHistory(3, HINGES, HINGES)],
    "SensorNoise": lambda: [SensorNoise(0.1), HingeHistory(2)],
    "IncludeOrientation": lambda: [IncludeOrientation("yaw"), HingeHistory(2, "orientation")],
    "CatFrames": lambda: [CatFrames(3, -1, HINGES, ["frames"])],
    "CatFrames in place": lambda: [CatFrames(3, -1, HINGES)],
    "TimeMaxPool": lambda: [TimeMaxPool(HINGES, T=3)],
    "StepCounter": lambda: [StepCounter(6)],
    "RewardSum": lambda: [RewardSum()],
    "RewardSum as reward": lambda: [RewardSum(reward_spec=True)],
    "InitTracker": lambda: [InitTracker()],
    "TensorDictPrimer": lambda: [
        TensorDictPrimer({"dice": Unbounded((2,))}, random=True, expand_specs=True)
    ],
    "RandomTruncationTransform": lambda: [StepCounter(), RandomTruncationTransform(2, 5)],
    "VecNormV2": lambda: [VecNormV2([*HINGES, "reward"])],
    "VecNormV2 over robots": lambda: [VecNormV2(HINGES, ["norm"], reduce_batch_dims=True)],
    "VecNormV2 without a state": lambda: [VecNormV2(HINGES, ["norm"], stateful=False)],
    "several": lambda: [
        ObservationNorm(0.1, 2.0, HINGES),
        VecNormV2(HINGES),
        CatFrames(2, -1, HINGES),
        HingeHistory(2),
        StepCounter(4),
        RewardScaling(0.1, 3.0),
        RewardSum(),
    ],
}

# TorchRL finds its own VecNormV2 experimental for environments with a batch.
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:Support of VecNormV2")]


def gecko(*transforms, physics=None, **settings):
    physics = {"threads": 1, **(physics or {})}
    env = LocomotionEnv("gecko", 4, time_limit=2.5, seed=3, physics=physics, **settings)
    return ResumableEnv(env, Compose(*transforms))


def steps(env, td, number):
    stepped = []
    for _ in range(number):
        one, td = env.step_and_maybe_reset(env.rand_action(td))
        stepped.append(one.clone())
    return stepped, td


def assert_same(found, expected):
    for one, other in zip(found, expected, strict=True):
        assert set(one.keys(True, True)) == set(other.keys(True, True))
        for key in one.keys(True, True):
            torch.testing.assert_close(one[key], other[key], rtol=0, atol=0, equal_nan=True)


def through_a_file(state):
    """As a checkpoint holds it: weights and plain values."""
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    return torch.load(file, weights_only=True)


def assert_resumes(make, before=13, after=14):
    torch.manual_seed(0)
    env = make()
    _, td = steps(env, env.reset(), before)
    state, generator = env.state_dict(), torch.get_rng_state()
    expected, _ = steps(env, td, after)
    torch.manual_seed(1)
    resumed = make()
    resumed.load_state_dict(through_a_file(state))
    torch.set_rng_state(generator)
    found, _ = steps(resumed, resumed.reset(), after)
    assert any(step["next", "done"].any() for step in expected)
    assert_same(found, expected)


@pytest.mark.parametrize("name", TRANSFORMS)
def test_with_transforms_it_goes_on_as_if_it_had_never_stopped(name):
    assert_resumes(lambda: gecko(*TRANSFORMS[name]()))


def test_targets_that_are_under_way_arrive():
    readings = ["hinge_position", "hinge_target", "hinge_torque", "ground_contact", "phase_clock"]
    assert_resumes(lambda: gecko(readings=readings, disturbances={"latency": 0.15}))


def test_transforms_of_the_environment_inside_go_on_too():
    def make():
        inside = TransformedEnv(
            LocomotionEnv("gecko", 4, time_limit=2.5, seed=3, physics={"threads": 1}),
            Compose(VecNormV2(HINGES), CatFrames(2, -1, HINGES)),
        )
        return ResumableEnv(inside, HingeHistory(2))

    assert_resumes(make)


class Pair(EnvBase):
    """Pairs of agents that count; their number is the environment's state."""

    def __init__(self):
        super().__init__(batch_size=[2])
        agents = {"shape": (2, 2)}
        self.observation_spec = Composite(
            agents=Composite({"a.b": Unbounded((2, 2, 1))}, **agents), shape=(2,)
        )
        self.action_spec = Composite(
            agents=Composite(action=Unbounded((2, 2, 1)), **agents), shape=(2,)
        )
        self.reward_spec = Unbounded((2, 1))
        self.count = torch.zeros(2, 2, 1)

    def get_extra_state(self):
        return {"count": self.count}

    def set_extra_state(self, state):
        self.count = state["count"].clone()

    def _reset(self, tensordict=None):
        where = torch.ones(2, 1).bool() if tensordict is None else tensordict["_reset"]
        self.count = torch.where(where[..., None], 0.0, self.count)
        return self.result()

    def _step(self, tensordict):
        self.count = self.count + tensordict["agents", "action"].abs()
        return self.result().set("reward", self.count.sum(1))

    def result(self):
        agents = TensorDict({"a.b": self.count.clone()}, [2, 2])
        done = (self.count > 5).any(1)
        flags = {"done": done, "terminated": done.clone()}
        return TensorDict({"agents": agents, **flags}, self.batch_size)

    def _set_seed(self, seed):
        pass


def test_nested_entries_come_back_with_their_batch_size():
    assert_resumes(lambda: ResumableEnv(Pair(), RewardSum()))
    env = ResumableEnv(Pair(), Compose())
    env.reset()
    env.load_state_dict(env.state_dict())
    assert env.reset()["agents"].batch_size == (2, 2)


def test_a_state_is_not_changed_by_what_follows():
    torch.manual_seed(0)
    env = gecko(*TRANSFORMS["several"]())
    _, td = steps(env, env.reset(), 5)
    state = env.state_dict()
    kept = through_a_file(state)
    steps(env, td, 5)
    one, other = gecko(*TRANSFORMS["several"]()), gecko(*TRANSFORMS["several"]())
    one.load_state_dict(state)
    other.load_state_dict(kept)
    torch.manual_seed(1)
    expected, _ = steps(other, other.reset(), 9)
    torch.manual_seed(1)
    assert_same(steps(one, one.reset(), 9)[0], expected)


def test_loading_uses_up_no_random_numbers():
    env = gecko(SensorNoise(0.1))
    env.reset()
    before = torch.get_rng_state()
    env.load_state_dict(env.state_dict())
    assert torch.equal(torch.get_rng_state(), before)


def test_only_the_first_reset_after_loading_begins_no_episode():
    env = gecko(StepCounter())
    steps(env, env.reset(), 3)
    env.load_state_dict(env.state_dict())
    assert env.reset()["step_count"].tolist() == [[3]] * 4
    assert env.reset()["step_count"].tolist() == [[0]] * 4
    env.load_state_dict(env.state_dict())
    chosen = torch.tensor([[True], [False], [True], [False]])
    env.load_state_dict(env.state_dict())
    td = steps(env, env.reset(), 2)[1]
    assert env.reset(td.set("_reset", chosen))["step_count"].flatten().tolist() == [0, 2, 0, 2]


def test_a_collector_goes_on_with_what_a_policy_reads_of_its_own():
    class Turning:
        """A policy that reads what it wrote one step ago."""

        out_keys = ("action", "phase")

        def __call__(self, td):
            phase = td.get("phase", torch.zeros(4, 1)) + 1
            return td.set("phase", phase).set("action", phase.sin().expand(4, 6))

    def batches(env, number):
        options = {"trust_policy": True, "track_traj_ids": False}
        collector = Collector(env, Turning(), frames_per_batch=28, total_frames=-1, **options)
        return list(islice(collector, number))

    expected = batches(gecko(RewardSum()), 3)
    env = gecko(RewardSum())
    found = batches(env, 1)
    resumed = gecko(RewardSum())
    resumed.load_state_dict(env.state_dict())
    assert_same(found + batches(resumed, 2), expected)


def test_a_state_of_other_transforms_is_refused():
    env = gecko(CatFrames(3, -1, HINGES))
    env.reset()
    with pytest.raises(RuntimeError, match="_cat_buffers_hinge_position"):
        gecko(CatFrames(2, -1, HINGES)).load_state_dict(env.state_dict())
