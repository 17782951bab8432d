"""Batches hold what the environment and the policy say."""

from itertools import islice
from types import SimpleNamespace

import pytest
import torch
from torchrl.envs import Compose, ExplorationType, TransformedEnv, set_exploration_type

from locomotion.envs import LocomotionEnv
from locomotion.envs.observations import make_transforms
from locomotion.training.build import make_collector, make_env, make_learner, policy_keys

pytestmark = pytest.mark.slow

FLAGS = ["done", "terminated", "truncated"]
SENSED = ["hinge_position", "core_orientation"]


def collecting(config):
    torch.manual_seed(config.seed)
    env = make_env(config)
    learner = make_learner(config, env)
    return learner, make_collector(env, learner, config.learner.steps)


def limit(time_limit):
    return "null" if time_limit is None else time_limit


@pytest.mark.parametrize("time_limit", [None, 1, 0.25])
@pytest.mark.parametrize(
    "obs",
    [
        ["+obs=history3"],
        ["obs.core_orientation.representation=rotation_6d", "obs.hinge_position.scale=0.5"],
    ],
    ids=["history3", "rotation_6d"],
)
@pytest.mark.parametrize("network", ["mlp", "gru"])
def test_batches_are_what_the_environment_says(
    configured, stepped_by_hand, network, obs, time_limit
):
    config = configured(*obs, f"env.time_limit={limit(time_limit)}", f"network={network}")
    _, collector = collecting(config)
    batches = list(islice(collector, 3))
    assert [batch.shape for batch in batches] == [(5, 12)] * 3
    batch = torch.cat(batches, 1)
    if time_limit == 0.25:
        assert batch["next", "truncated"].all()

    # Against the robots without transforms ...
    readings = [name for name in SENSED if name in batch]
    before, after = stepped_by_hand(batch["action"], time_limit, readings=readings)
    for key in readings:
        assert torch.equal(batch[key], before[key]), key
    for key in [*readings, "reward", *FLAGS]:
        assert torch.equal(batch["next", key], after[key]), key

    # ... and with those of the configuration, stepped by TorchRL's own environment.
    env = LocomotionEnv(
        "gecko", 5, readings=readings, time_limit=time_limit, seed=0, physics={"threads": 1}
    )
    env = TransformedEnv(env, Compose(*make_transforms(config.obs)[0]))
    td = env.reset()
    for step, action in enumerate(batch["action"].unbind(1)):
        for key in policy_keys(config):
            assert torch.equal(td[key], batch[key][:, step]), key
        stepped, td = env.step_and_maybe_reset(td.set("action", action))
        for key in policy_keys(config):
            assert torch.equal(stepped["next", key], batch["next", key][:, step]), key


@pytest.mark.parametrize("network", ["mlp", "gru"])
def test_log_probabilities_are_those_of_the_policy(configured, network):
    learner, collector = collecting(configured("+obs=history3", f"network={network}"))
    for batch in islice(collector, 3):
        for step in range(12):
            now = batch[:, step].exclude("next", "loc", "scale", "action_log_prob")
            distribution = learner.policy.get_dist(now)
            log_prob = distribution.log_prob(batch["action"][:, step])
            torch.testing.assert_close(batch["action_log_prob"][:, step], log_prob)


def test_actions_are_samples_of_the_policy(configured):
    learner, collector = collecting(configured("env.num_envs=64", "network.initial_deviation=0.37"))
    batch = next(iter(collector))
    with set_exploration_type(ExplorationType.DETERMINISTIC), torch.no_grad():
        mean = learner.policy(batch.clone())["action"]
    z = (batch["action"] - mean) / 0.37
    assert z.numel() == 64 * 12 * 6
    assert z.mean().abs() < 0.06  # four standard errors
    assert (z.std() - 1).abs() < 0.05


def test_a_policy_that_has_learned_collects_the_next_batch(configured):
    learner, collector = collecting(configured())
    for batch in islice(collector, 3):
        now = batch[:, 0].exclude("next", "loc", "scale", "action_log_prob")
        torch.testing.assert_close(learner.policy.get_dist(now).base_dist.loc, batch["loc"][:, 0])
        with torch.no_grad():
            for parameter in learner.policy.parameters():
                parameter.add_(0.1)
        collector.update_policy_weights_()


def test_a_batch_keeps_its_memory_when_the_next_one_comes(configured):
    _, collector = collecting(configured("env.time_limit=1"))
    batches, copies = [], []
    for batch in islice(collector, 3):
        batches.append(batch)
        copies.append(batch.clone())
    for batch, copy in zip(batches, copies):
        assert (batch == copy).all()


def test_making_a_collector_draws_no_random_numbers(configured):
    env = make_env(configured())
    # TorchRL tries a policy once that does not say what it writes.
    learner = SimpleNamespace(policy=lambda td: td.set("action", torch.randn(5, 6)))
    before = torch.get_rng_state()
    collector = make_collector(env, learner, 12)
    assert torch.equal(torch.get_rng_state(), before)
    assert next(iter(collector))["action"].shape == (5, 12, 6)


def test_robots_on_the_cpu_wake_up_no_gpu(configured, monkeypatch):
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    for name in ("init", "get_rng_state", "set_rng_state"):
        monkeypatch.setattr(torch.cuda, name, lambda *_: pytest.fail("a GPU was woken up"))
    env = make_env(configured())
    env.reset()
    env.load_state_dict(env.state_dict())
    make_collector(env, make_learner(configured(), env), 12)


@pytest.mark.parametrize("layers", [1, 2])
def test_a_memory_is_carried_over_and_forgotten_with_its_robot(configured, layers):
    config = configured("network=gru", f"network.layers={layers}", "env.time_limit=1.25")
    _, collector = collecting(config)
    batch = torch.cat(list(islice(collector, 3)), 1)
    memory, written = batch["recurrent_state"], batch["next", "recurrent_state"]
    assert memory.shape == (5, 36, layers, 64)
    done = batch["next", "done"][..., 0]
    assert (written != 0).any(-1).all()
    starts = torch.cat([torch.ones(5, 1, dtype=torch.bool), done[:, :-1]], 1)
    assert torch.equal(batch["is_init"][..., 0], starts)
    assert (memory[starts] == 0).all()
    # Batches begin at steps 12 and 24, episodes at each fifth one.
    goes_on = ~starts[:, 1:]
    assert goes_on[:, 11].all() and goes_on[:, 23].all()
    assert torch.equal(memory[:, 1:][goes_on], written[:, :-1][goes_on])


def test_robots_that_end_at_different_times_forget_alone(configured, target_env):
    config = configured("network=gru")
    env = make_env(config, target_env(5, 4))
    collector = make_collector(env, make_learner(config, env, ["target"]), 12)
    env.base_env.ages = torch.arange(5.0)[:, None] % 4
    batch = torch.cat(list(islice(collector, 3)), 1)
    starts = batch["is_init"][..., 0]
    assert 5 < starts.sum() < 60 and not starts[:, 1:].all(0).any()
    for step in range(1, 36):
        expected = torch.where(
            starts[:, step, None, None], 0.0, batch["next", "recurrent_state"][:, step - 1]
        )
        assert torch.equal(batch["recurrent_state"][:, step], expected)
