"""The training collector, against the environment stepped in TorchRL's own way."""

import pytest
import torch

from locomotion.agents import PPO, make_critic
from locomotion.assembly import make_env, make_policy, policy_keys
from locomotion.command_line.composing import compose
from locomotion.train import make_collector

STEPS = 12


def collecting(*overrides):
    config = compose(
        "env.num_envs=5",
        f"ppo.steps={STEPS}",
        "ppo.minibatch_size=60",
        "ppo.iterations=3",
        *overrides,
    )
    torch.manual_seed(config.seed)
    env = make_env(config)
    actor = make_policy(config, env)
    return config, actor, make_collector(config, env, actor)


@pytest.mark.parametrize("time_limit", ["null", "1", "3", "0.25"])
@pytest.mark.parametrize("obs", ["hinges", "history3", "hinges_orientation,rotation_6d"])
def test_batches_are_what_the_environment_says(obs, time_limit):
    obs, *representation = obs.split(",")
    overrides = [f"obs.orientation={name}" for name in representation]
    config, actor, collector = collecting(f"+obs={obs}", f"env.time_limit={time_limit}", *overrides)
    batches = list(collector)
    assert len(batches) == 3

    env = make_env(config)
    td = env.reset()
    for batch in batches:
        assert batch.shape == (5, STEPS)
        for step in range(STEPS):
            for key in policy_keys(config):
                assert torch.equal(td[key], batch[key][:, step])
            td["action"] = batch["action"][:, step]
            stepped, td = env.step_and_maybe_reset(td)
            for key in [*policy_keys(config), "reward", "done", "terminated", "truncated"]:
                assert torch.equal(stepped["next", key], batch["next", key][:, step]), key
        log_prob = actor.get_dist(batch).log_prob(batch["action"])
        torch.testing.assert_close(batch["action_log_prob"], log_prob, atol=1e-5, rtol=1e-5)


def test_actions_are_samples_of_the_policy():
    _, actor, collector = collecting("env.num_envs=64")
    with torch.no_grad():
        actor.module[0].log_scale.fill_(-1.0)
    batch = next(iter(collector))
    normal = actor.get_dist(batch).base_dist
    z = (batch["action"] - normal.mean) / normal.stddev
    assert z.numel() == 64 * STEPS * 6
    assert z.mean().abs() < 0.06  # four standard errors
    assert (z.std() - 1).abs() < 0.05


@pytest.mark.parametrize("time_limit", ["null", "1"])
def test_advantages_are_generalised_advantage_estimates(time_limit):
    """Schulman et al. 2016, equation 16, by the book; what a time limit cuts off is bootstrapped."""
    config, actor, collector = collecting("+obs=history3", f"env.time_limit={time_limit}")
    critic = make_critic(collector.env.observation_spec, policy_keys(config))
    batch = next(iter(collector))
    values = critic(batch.clone())["state_value"].squeeze(-1).detach()
    following = critic(batch["next"].clone())["state_value"].squeeze(-1).detach()
    delta = batch["next", "reward"].squeeze(-1) + config.ppo.gamma * following - values
    expected = torch.zeros_like(delta)
    running = torch.zeros(5)
    for step in reversed(range(STEPS)):
        goes_on = ~batch["next", "done"][:, step, 0]
        running = delta[:, step] + config.ppo.gamma * config.ppo.gae_lambda * running * goes_on
        expected[:, step] = running
    PPO(actor, critic, 6, 60, config.ppo).update(batch)
    torch.testing.assert_close(batch["advantage"].squeeze(-1), expected, atol=1e-5, rtol=1e-4)
