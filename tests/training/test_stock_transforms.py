"""TorchRL's transforms train as they are: the policy sees, and is paid, what they wrote."""

import pytest
import torch
from torchrl.data import Unbounded
from torchrl.envs import (
    CatFrames,
    CatTensors,
    DoubleToFloat,
    ExcludeTransform,
    InitTracker,
    ObservationNorm,
    RenameTransform,
    RewardClipping,
    RewardScaling,
    RewardSum,
    SelectTransform,
    SignTransform,
    StepCounter,
    TensorDictPrimer,
    TransformedEnv,
    VecNormV2,
)

from locomotion import train
from locomotion.envs import LocomotionEnv
from locomotion.options import ConfigError
from locomotion.training.build import make_learner
from locomotion.transforms import HingeHistory, SensorNoise

# TorchRL finds its own VecNormV2 experimental for environments with a batch.
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:Support of VecNormV2")]
HINGES = "hinge_position"


@pytest.fixture
def trained(configured, keeping, rows, tmp_path):
    """Trains a bit, and returns the batches that were learned from, side by side, and the rows."""

    def run(*transforms, in_keys=None, overrides=(), **passed):
        kept, config = [], configured(*overrides)

        def learner(env):
            kept.append(keeping(make_learner(config, env, in_keys)))
            return kept[0]

        result = train(config, tmp_path / "run", transforms=transforms, learner=learner, **passed)
        found = rows(result.folder)
        assert len(found) == 3
        batch = torch.cat(kept[0].batches, 1)
        # The column is that of the reward that was learned from.
        means = [float(batch["next", "reward"].mean()) for batch in kept[0].batches]
        assert [row["mean_reward"] for row in found] == pytest.approx(means, rel=1e-6)
        assert all(torch.isfinite(torch.tensor(list(row.values()))).all() for row in found)
        assert kept[0].policy.in_keys[: len(in_keys or ())] == (in_keys or [])
        return batch

    return run


def both(batch, key):
    """An entry now and after the step."""
    return torch.stack([batch[key], batch["next", key]])


def test_observation_norm(trained, stepped_by_hand):
    batch = trained(
        ObservationNorm(0.5, 2.0, [HINGES], ["scaled"]), in_keys=["scaled", "core_orientation"]
    )
    before, after = stepped_by_hand(batch["action"])
    assert torch.equal(both(batch, HINGES), torch.stack([before[HINGES], after[HINGES]]))
    torch.testing.assert_close(both(batch, "scaled"), 2.0 * both(batch, HINGES) + 0.5)


def test_observation_norm_in_place_on_a_history(trained, stepped_by_hand):
    key = "hinge_position_history"
    batch = trained(ObservationNorm(0.5, 2.0, [key]), overrides=["+obs=history3"])
    before, after = stepped_by_hand(batch["action"])
    now = torch.stack([before[HINGES], after[HINGES]])
    torch.testing.assert_close(both(batch, key)[..., :6], 2.0 * now + 0.5)
    # The memory holds what was sensed, not what was scaled.
    torch.testing.assert_close(batch[key][:, 1:, 6:12], 2.0 * before[HINGES][:, :-1] + 0.5)
    torch.testing.assert_close(batch[key][:, 2:, 12:], 2.0 * before[HINGES][:, :-2] + 0.5)


def test_vec_norm(trained, stepped_by_hand):
    batch = trained(VecNormV2([HINGES], ["norm"]), in_keys=["norm", "core_orientation"])
    before, after = stepped_by_hand(batch["action"])
    # Running means with TorchRL's defaults, each corrected for having begun at 0.
    mean, square = torch.zeros(5, 6), torch.zeros(5, 6)
    seen = [before[HINGES][:, 0], *after[HINGES].unbind(1)]
    norms = []
    for count, value in enumerate(seen, 1):
        mean = mean + 1e-4 * (value - mean)
        square = square + 1e-4 * (value**2 - square)
        share = 1 - 0.9999**count
        deviation = ((square - mean**2) / share).sqrt().clamp_min(1e-4)
        norms.append((value - mean / share) / deviation)
    expected = torch.stack(norms[1:], 1)
    torch.testing.assert_close(batch["next", "norm"], expected, rtol=1e-2, atol=1e-2)
    assert torch.equal(batch["norm"][:, 1:], batch["next", "norm"][:, :-1])


def test_reward_scaling(trained, stepped_by_hand):
    batch = trained(RewardScaling(0.25, 100.0), overrides=["env.time_limit=1"])
    _, after = stepped_by_hand(batch["action"], 1)
    assert after["reward"].abs().sum() > 0
    torch.testing.assert_close(batch["next", "reward"], 100.0 * after["reward"] + 0.25)


def test_reward_clipping(trained, stepped_by_hand):
    batch = trained(RewardClipping(-0.005, 0.005))
    _, after = stepped_by_hand(batch["action"])
    assert torch.equal(batch["next", "reward"], after["reward"].clamp(-0.005, 0.005))


def test_step_counter_ends_episodes(trained):
    batch = trained(StepCounter(5))
    steps = torch.arange(36) % 5
    assert torch.equal(batch["step_count"][..., 0], steps.expand(5, 36))
    assert torch.equal(batch["next", "step_count"][..., 0], steps.expand(5, 36) + 1)
    for key in ("truncated", "done"):
        assert torch.equal(batch["next", key][..., 0], (steps == 4).expand(5, 36))
    # Robots begin anew near the origin.
    assert not batch["next", "terminated"].any()
    assert (batch[HINGES][:, 5] != batch["next", HINGES][:, 4]).any(-1).all()


@pytest.mark.parametrize("reward_spec", [False, True])
def test_reward_sum_can_be_seen_by_the_policy(trained, reward_spec):
    transforms = [RewardSum(reward_spec=reward_spec)]
    seen = None if reward_spec else [HINGES, "episode_reward"]
    batch = trained(*transforms, in_keys=seen, overrides=["env.time_limit=1"])
    reward = batch["next", "reward"].unflatten(1, (9, 4))  # episodes of four steps
    sums = batch["next", "episode_reward"].unflatten(1, (9, 4))
    torch.testing.assert_close(sums, reward.cumsum(2))
    if not reward_spec:
        assert (batch["episode_reward"].unflatten(1, (9, 4))[:, :, 0] == 0).all()


def test_a_transform_that_reads_what_another_one_wrote(trained):
    chain = [
        ObservationNorm(0.5, 2.0, [HINGES], ["scaled"]),
        CatFrames(2, -1, ["scaled"], ["frames"], padding="constant"),
        CatTensors(["frames", "core_orientation"], "all", del_keys=False),
        HingeHistory(2, "all", "past"),
    ]
    batch = trained(*chain, in_keys=["past"])
    scaled = 2.0 * batch[HINGES] + 0.5
    # CatTensors sorts what it is given by name.
    expected = torch.cat([batch["core_orientation"][:, 1:], scaled[:, :-1], scaled[:, 1:]], -1)
    torch.testing.assert_close(batch["past"][:, 1:, :16], expected)
    torch.testing.assert_close(batch["past"][:, 2:, 16:], expected[:, :-1])


#: By name: transforms, and what the policy then sees.
OTHERS = {
    "RenameTransform": (lambda: [RenameTransform([HINGES], ["angles"])], ["angles"]),
    "CatTensors": (lambda: [CatTensors([HINGES, "core_orientation"], "all")], ["all"]),
    "SelectTransform": (lambda: [SelectTransform(HINGES)], [HINGES]),
    "ExcludeTransform": (lambda: [ExcludeTransform("core_orientation")], [HINGES]),
    "SignTransform": (lambda: [SignTransform([HINGES], ["signs"])], ["signs"]),
    "SensorNoise": (lambda: [SensorNoise(0.1)], [HINGES]),
    "what counts": (lambda: [InitTracker(), StepCounter(7), RewardSum()], [HINGES]),
    "DoubleToFloat": (lambda: [DoubleToFloat()], None),
    "a function": (lambda: [lambda td: td.set(HINGES, td[HINGES] + 1)], None),
    "VecNormV2": (lambda: [VecNormV2([HINGES, "reward"])], None),
}


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("network", ["mlp", "gru"])
def test_others_train_too(configured, rows, tmp_path, network, name):
    make, in_keys = OTHERS[name]
    config = configured(f"network={network}", "env.time_limit=2")
    result = train(config, tmp_path / "run", transforms=make(), in_keys=in_keys)
    assert len(rows(result.folder)) == 3


def test_transforms_may_be_around_the_environment_that_is_passed(trained, stepped_by_hand):
    env = LocomotionEnv("gecko", 5, seed=0, physics={"threads": 1})
    env = TransformedEnv(env, RewardScaling(0.0, 10.0))
    batch = trained(RewardScaling(1.0, 1.0), env=env)
    _, after = stepped_by_hand(batch["action"])
    torch.testing.assert_close(batch["next", "reward"], 10.0 * after["reward"] + 1.0)


@pytest.mark.parametrize(
    ("name", "in_keys", "missing"),
    [
        ("SensorNoise", ["hinge_positions"], "'hinge_positions'"),
        ("SensorNoise", [("agents", HINGES)], r"\('agents', 'hinge_position'\)"),
        ("RenameTransform", None, "'hinge_position'"),
        ("ExcludeTransform", None, "'core_orientation'"),
        ("CatTensors", [HINGES], "'hinge_position'"),
    ],
)
def test_an_entry_that_nobody_writes_is_refused_by_name(
    configured, tmp_path, name, in_keys, missing
):
    words = rf"the policy is to see {missing}, but the environment writes \w+"
    with pytest.raises(ConfigError, match=words):
        train(configured(), tmp_path / "run", transforms=OTHERS[name][0](), in_keys=in_keys)


def test_a_number_that_is_no_vector_is_refused_by_name(configured, tmp_path):
    number = TensorDictPrimer({"number": Unbounded(())}, expand_specs=True)
    with pytest.raises(ConfigError, match="'number', which is a number, not a vector"):
        train(configured(), tmp_path / "run", transforms=[number], in_keys=["number"])
