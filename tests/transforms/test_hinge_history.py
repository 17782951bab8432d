"""A history is what its definition says, wherever it is used."""

import doctest

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import LazyTensorStorage, ReplayBuffer, SliceSampler
from torchrl.envs import (
    Compose,
    GymEnv,
    InitTracker,
    ObservationNorm,
    ParallelEnv,
    PendulumEnv,
    SerialEnv,
    StepCounter,
    TransformedEnv,
    UnsqueezeTransform,
    check_env_specs,
)

from locomotion.transforms import (
    HingeHistory,
    IncludeOrientation,
    SensorNoise,
    hinge_history,
    orientation,
    sensor_noise,
)


def pendulum(max_steps=None):
    env = TransformedEnv(PendulumEnv(), UnsqueezeTransform(-1, in_keys=["th"], out_keys=["angle"]))
    return env if max_steps is None else env.append_transform(StepCounter(max_steps))


def remembering_pendulum(max_steps=None):
    return pendulum(max_steps).append_transform(HingeHistory(3, in_keys=["angle"]))


@pytest.mark.parametrize("steps", [1, 2, 5])
def test_newest_first_with_zeros_before_the_start(counting_env, histories, steps):
    env = TransformedEnv(counting_env([9, 9]), HingeHistory(steps, "angle"))
    rollout = env.rollout(8)
    starts = torch.arange(8).eq(0).expand(2, 8)
    expected = histories(rollout["angle"], starts, steps)
    assert torch.equal(rollout["angle_history"], expected)
    assert torch.equal(rollout["next", "angle_history"][:, :-1], expected[:, 1:])


@pytest.mark.parametrize("others", [None, float("nan")])
def test_it_begins_anew_for_robots_that_are_reset_alone(counting_env, histories, others):
    env = TransformedEnv(counting_env([3, 4, 7, 1], others), HingeHistory(3, "angle"))
    rollout = env.rollout(20, break_when_any_done=False)
    done = rollout["next", "done"][..., 0]
    starts = torch.cat([torch.ones(4, 1, dtype=torch.bool), done[:, :-1]], -1)
    assert starts.sum() > 20 and not starts.all(0)[1:].any()
    assert torch.equal(rollout["angle_history"], histories(rollout["angle"], starts, 3))
    # What ends an episode is seen with what came before, not with what follows.
    following = torch.cat([rollout["next", "angle"], rollout["angle_history"][..., :4]], -1)
    assert torch.equal(rollout["next", "angle_history"], following)


@pytest.mark.parametrize("inside", [True, False])
def test_inside_and_outside_a_batched_environment(histories, inside):
    if inside:
        env = SerialEnv(3, [lambda n=n: remembering_pendulum(n) for n in (3, 4, 7)])
    else:
        env = SerialEnv(3, [lambda n=n: pendulum(n) for n in (3, 4, 7)])
        env = TransformedEnv(env, HingeHistory(3, "angle"))
    rollout = env.rollout(20, break_when_any_done=False)
    starts = rollout["step_count"].squeeze(-1) == 0
    assert starts.sum() > 8
    assert torch.equal(rollout["angle_history"], histories(rollout["angle"], starts, 3))


@pytest.mark.parametrize("together", [False, True])
def test_agents_with_flags_of_their_own(agents_env, histories, together):
    lengths = [[2, 3, 9], [4, 1, 3]]
    keys = {"in_keys": [("agents", "angle")], "out_keys": [("agents", "past")]}
    env = TransformedEnv(agents_env(lengths, together), HingeHistory(3, **keys))
    assert env.observation_spec["agents", "past"].shape == (2, 3, 6)
    rollout = env.rollout(15, break_when_any_done=False)
    # Where a group has a flag of its own, that is the one which counts.
    done = rollout["next", "done"] if together else rollout["next", "agents", "done"][..., 0]
    done = done.expand(2, 15, 3)
    assert rollout["next", "agents", "done"].sum() > done.sum() / 2 > 4
    starts = torch.cat([torch.ones(2, 1, 3, dtype=torch.bool), done[:, :-1]], 1)

    def rows(entry):
        return entry.transpose(1, 2).flatten(0, 1)

    expected = histories(rows(rollout["agents", "angle"]), rows(starts), 3)
    assert torch.equal(rows(rollout["agents", "past"]), expected)


def test_several_entries_each_have_a_memory(counting_env, histories):
    env = TransformedEnv(counting_env([3, 5]), HingeHistory(2, ["speed", "angle"], ["v", "a"]))
    rollout = env.rollout(9, break_when_any_done=False)
    done = rollout["next", "done"][..., 0]
    starts = torch.cat([torch.ones(2, 1, dtype=torch.bool), done[:, :-1]], -1)
    assert torch.equal(rollout["v"], histories(rollout["speed"], starts, 2))
    assert torch.equal(rollout["a"], histories(rollout["angle"], starts, 2))


def test_an_environment_that_is_given_nothing_but_actions(counting_env):
    expected = TransformedEnv(counting_env([99, 99]), HingeHistory(3, "angle")).rollout(6)
    env = TransformedEnv(counting_env([99, 99]), HingeHistory(3, "angle"))
    env.reset()
    for t in range(6):
        following = env.step(TensorDict({"action": torch.zeros(2, 1)}, [2]))["next"]
        assert torch.equal(following["angle_history"], expected["next", "angle_history"][:, t])


def test_its_memory_is_not_what_it_wrote(counting_env):
    expected = TransformedEnv(counting_env([9]), HingeHistory(3, "angle")).rollout(3)
    env = TransformedEnv(counting_env([9]), HingeHistory(3, "angle"))
    td = env.reset()
    for t in range(3):
        td["angle_history"].fill_(7)
        td = env.step(env.rand_action(td))["next"].exclude("reward")
        assert torch.equal(td["angle_history"], expected["next", "angle_history"][:, t])


def test_the_flag_of_a_group_counts_more_than_those_of_its_agents(agents_env):
    keys = {"in_keys": [("agents", "angle")], "out_keys": [("agents", "past")]}
    env = TransformedEnv(agents_env([[9, 9], [9, 9]], together=True), HingeHistory(2, **keys))
    td = env.rollout(4)[:, -1]["next"]
    td["_reset"] = torch.tensor([[True], [False]])
    td["agents", "_reset"] = torch.tensor([[True, False], [True, False]])[..., None]
    before, now = td.clone(), env.reset(td)
    assert (now["agents", "past"][0, :, 2:] == 0).all()
    assert torch.equal(now["agents", "past"][0, :, :2], now["agents", "angle"][0])
    assert torch.equal(now["agents", "past"][1], before["agents", "past"][1])
    following = env.step(env.rand_action(now))["next", "agents", "past"]
    assert torch.equal(following[..., 2:], now["agents", "angle"])


def test_its_state_is_its_memory(counting_env):
    env = TransformedEnv(counting_env([99, 99]), HingeHistory(3, ["angle", "speed"]))
    env.rollout(5)
    state = {name: value for name, value in env.transform.state_dict().items()}
    action = TensorDict({"action": torch.zeros(2, 1)}, [2])
    expected = env.step(action.clone())["next"]
    again = TransformedEnv(counting_env([99, 99]), HingeHistory(3, ["angle", "speed"]))
    again.transform.load_state_dict(state)
    again.base_env.seen.copy_(env.base_env.seen - 1)
    found = again.step(action)["next"]
    for key in ("angle_history", "speed_history"):
        assert torch.equal(found[key], expected[key])


@pytest.mark.parametrize("batched", [SerialEnv, pytest.param(ParallelEnv, marks=pytest.mark.slow)])
def test_specs_hold_inside_and_outside_batched_environments(batched):
    check_env_specs(remembering_pendulum())
    for env in (
        batched(2, remembering_pendulum),
        TransformedEnv(batched(2, pendulum), HingeHistory(2, in_keys=["angle"])),
    ):
        check_env_specs(env)
        env.close()


@pytest.mark.parametrize("together", [False, True])
def test_specs_hold_for_agents(agents_env, together):
    env = agents_env([[2, 3], [4, 1]], together)
    check_env_specs(TransformedEnv(env, HingeHistory(2, [("agents", "angle")])))


def sliced(rollout, transform, slice_len=4, time=True):
    """A sample of slices, which begin anywhere."""
    sampler = SliceSampler(slice_len=slice_len, end_key=("next", "done"), strict_length=True)
    buffer = ReplayBuffer(
        storage=LazyTensorStorage(rollout.numel()), sampler=sampler, batch_size=6 * slice_len
    )
    if time:
        buffer.append_transform(lambda td: td.reshape(-1, slice_len).refine_names(None, "time"))
    buffer.append_transform(transform)
    buffer.extend(rollout.reshape(-1))
    return buffer.sample()


def episodes(counting_env, lengths, steps=21, **keys):
    """Rollouts with what histories there should be."""
    env = counting_env(lengths)
    env = TransformedEnv(env, Compose(InitTracker(), HingeHistory(3, "angle", **keys)))
    return env.rollout(steps, break_when_any_done=False)


@pytest.mark.parametrize("time", [True, False])
def test_a_replay_buffer_keeps_the_histories_that_were_stored(counting_env, time):
    rollout = episodes(counting_env, [7, 7])
    sample = sliced(rollout, HingeHistory(3, "angle"), time=time)
    known = {tuple(row["angle"].tolist()): row for row in rollout.reshape(-1)}
    assert not sample["is_init"].reshape(-1, 4)[:, 0].all()
    for row in sample.reshape(-1):
        expected = known[tuple(row["angle"].tolist())]
        assert torch.equal(row["angle_history"], expected["angle_history"])
        assert torch.equal(row["next", "angle_history"], expected["next", "angle_history"])


def test_a_replay_buffer_rebuilds_the_history_of_whole_episodes(counting_env):
    rollout = episodes(counting_env, [7, 7])
    sample = sliced(rollout, HingeHistory(3, "angle", "rebuilt"), slice_len=7)
    assert torch.equal(sample["rebuilt"], sample["angle_history"])
    assert torch.equal(sample["next", "rebuilt"], sample["next", "angle_history"])


@pytest.mark.parametrize("stored", ["all", "no next", "no flag of the end"])
def test_what_begins_within_an_episode_is_refused_when_it_is_rebuilt(counting_env, stored):
    rollout = episodes(counting_env, [7, 7])
    without = {"all": (), "no next": [("next", "angle")], "no flag of the end": []}[stored]
    sample = sliced(rollout.exclude(*without), lambda td: td)
    if stored == "no flag of the end":
        sample["next", "done"].zero_()
    rebuild = HingeHistory(3, "angle", "rebuilt")
    with pytest.raises(
        ValueError, match="'angle' cannot be rebuilt, as rows begin within episodes"
    ):
        rebuild(sample)
    with pytest.raises(ValueError, match=r"as no 'is_init' .*; store the one that the environment"):
        rebuild(sample.exclude("is_init"))
    with pytest.raises(ValueError, match="as no dimension is named 'time'"):
        sliced(rollout.exclude(*without), rebuild, time=False)


def test_slices_in_one_row_are_refused_when_they_are_rebuilt(counting_env):
    rebuild = HingeHistory(3, "angle", "rebuilt")
    first, second = episodes(counting_env, [9, 9], steps=9).unbind(0)
    for parts in ([first[:4], second[5:]], [first[:4], first[5:]]):
        row = torch.cat(parts).refine_names("time")
        with pytest.raises(ValueError, match="as a row holds parts of several episodes"):
            rebuild(row.clone())
        ended = row.exclude(("next", "angle"))  # as TorchRL marks where a slice ends
        ended["next", "done"][3] = True
        with pytest.raises(ValueError, match="as a row holds parts of several episodes"):
            rebuild(ended)
    row = torch.cat([first[:4], second]).refine_names("time")
    assert torch.equal(rebuild(row)["rebuilt"], row["angle_history"])


def test_stored_trajectories_may_hold_several_episodes_and_lack_what_follows(counting_env):
    rollout = episodes(counting_env, [3, 4, 7]).refine_names(..., "time")
    rebuild = HingeHistory(3, "angle", "rebuilt")
    assert torch.equal(rebuild(rollout.clone())["rebuilt"], rollout["angle_history"])
    alone = rebuild(rollout.select("angle", "is_init"))
    assert torch.equal(alone["rebuilt"], rollout["angle_history"])
    assert ("next", "rebuilt") not in alone.keys(True)
    across = rebuild(rollout.transpose(0, 1).refine_names("time", None))
    assert torch.equal(across["rebuilt"].transpose(0, 1), rollout["angle_history"])


@pytest.mark.parametrize("together", [False, True])
def test_stored_trajectories_of_agents(agents_env, together):
    keys = {"in_keys": [("agents", "angle")], "out_keys": [("agents", "past")]}
    env = TransformedEnv(agents_env([[2, 3, 9], [4, 1, 3]], together), InitTracker())
    env.append_transform(HingeHistory(3, **keys))
    rollout = env.rollout(15, break_when_any_done=False)
    rebuilt = HingeHistory(3, **keys)(
        rollout.exclude(("agents", "past"), ("next", "agents", "past"))
    )
    assert torch.equal(rebuilt["agents", "past"], rollout["agents", "past"])
    assert torch.equal(rebuilt["next", "agents", "past"], rollout["next", "agents", "past"])


def test_values_and_histories_under_one_key_are_refused_in_a_replay_buffer(counting_env):
    rollout = episodes(counting_env, [7, 7])
    with pytest.raises(ValueError, match="in_keys and out_keys are both 'angle'"):
        HingeHistory(3, "angle", "angle")(rollout)


def test_clones_in_two_environments_have_a_memory_each(counting_env):
    expected = TransformedEnv(counting_env([9, 9]), HingeHistory(3, "angle")).rollout(5)
    env = TransformedEnv(counting_env([9, 9]), HingeHistory(3, "angle"))
    td, seen = env.reset(), []
    other = TransformedEnv(counting_env([2, 2]), env.transform.clone())
    for _ in range(5):
        other.rollout(2)
        seen.append(td["angle_history"])
        td = env.step_mdp(env.rand_step(td))
    assert torch.equal(torch.stack(seen, 1), expected["angle_history"])


@pytest.mark.parametrize("steps", [0, -2, 2.5, "3", None, True])
def test_a_wrong_number_of_steps_is_named(steps):
    with pytest.raises(ValueError, match="steps must be a whole number of at least 1"):
        HingeHistory(steps)


def test_wrong_numbers_of_keys_are_named():
    with pytest.raises(ValueError, match="got 2 in_keys but 1 out_keys"):
        HingeHistory(2, in_keys=["a", "b"], out_keys=["c"])


@pytest.mark.parametrize("keys", [None, 3, [], [3], ("angle", 3), [()], ["angle", "angle"]])
def test_what_is_no_key_is_named(keys):
    with pytest.raises(ValueError, match="in_keys must be .*key"):
        HingeHistory(2, keys)
    with pytest.raises(ValueError, match="in_keys must be .*key"):
        SensorNoise(0.1, keys)
    with pytest.raises(ValueError, match="in_keys must be .*key"):
        IncludeOrientation("yaw", keys)


def added(transform):
    """Ways to add a transform to an environment."""
    return {
        "alone": lambda env: TransformedEnv(env, transform),
        "in a chain": lambda env: TransformedEnv(env, Compose(StepCounter(), transform)),
        "appended": lambda env: TransformedEnv(env, StepCounter()).append_transform(transform),
        "inserted": lambda env: TransformedEnv(env, StepCounter()).insert_transform(0, transform),
    }


@pytest.mark.parametrize("way", added(None))
@pytest.mark.parametrize("make", [HingeHistory, SensorNoise])
def test_a_missing_entry_is_named_with_those_that_are_there(counting_env, make, way):
    for keys in ("hinge_position", ("agents", "angle")):
        with pytest.raises(KeyError) as caught:
            added(make(2, keys))[way](counting_env([3]))
        assert f"no entry {keys!r}; in_keys must be among 'angle', 'speed'" in str(caught.value)
    with pytest.raises(
        KeyError, match="no entry 'core_orientation'; in_keys must be among 'angle'"
    ):
        added(IncludeOrientation())[way](counting_env([3]))


@pytest.mark.parametrize("way", added(None))
def test_a_number_that_is_no_vector_is_named(agents_env, way):
    for env in (PendulumEnv(), SerialEnv(2, PendulumEnv)):
        with pytest.raises(ValueError, match="'th' is a number, not a vector; UnsqueezeTransform"):
            added(HingeHistory(2, "th"))[way](env)
        with pytest.raises(ValueError, match="'th' is a number, not a vector; UnsqueezeTransform"):
            added(IncludeOrientation("yaw", "th"))[way](env)
    with pytest.raises(ValueError, match=r"\('agents', 'size'\) is a number, not a vector"):
        added(HingeHistory(2, ("agents", "size")))[way](agents_env([[2, 3]]))


def test_a_group_of_entries_is_none_of_them(agents_env):
    with pytest.raises(
        KeyError, match=r"no entry 'agents'; in_keys must be among \('agents', 'ang"
    ):
        TransformedEnv(agents_env([[2, 3]]), HingeHistory(2, "agents"))


def test_entries_are_looked_at_later_after_a_transform_that_has_no_statistics_yet():
    env = TransformedEnv(
        GymEnv("Pendulum-v1"),
        Compose(ObservationNorm(in_keys=["observation"]), HingeHistory(2, "observation")),
    )
    env.transform[0].init_stats(10)
    assert env.rollout(3)["observation_history"].shape == (3, 6)
    with pytest.raises(KeyError, match="no entry 'speed'"):
        env.append_transform(HingeHistory(2, "speed"))


@pytest.mark.parametrize("module", [hinge_history, orientation, sensor_noise])
def test_the_examples_run(module):
    result = doctest.testmod(module)
    assert result.attempted and not result.failed


def test_many_histories_take_no_longer_than_they_must(counting_env):
    env = TransformedEnv(counting_env([3, 3]), Compose())
    for index in range(40):  # at twice the time for each one more, these would take years
        env.append_transform(HingeHistory(2, ["angle"], [f"history_{index}"]))
    assert env.reset()["history_39"].shape == (2, 4)
