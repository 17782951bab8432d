"""An update of PPO is the one that its formulas give, with and without a memory."""

import pytest
import torch
from torch.distributions import Normal

from locomotion.agents.learners import Optimizer, Schedule

GAMMA, LAMBDA, CLIP, ENTROPY = 0.9, 0.8, 0.1, 0.3
#: One plain step down the gradient, as long as the gradient.
PLAIN = {
    "optimizer": Optimizer.sgd,
    "schedule": Schedule.constant,
    "actor_lr": 1.0,
    "critic_lr": 1.0,
    "gamma": GAMMA,
    "gae_lambda": LAMBDA,
    "clip_epsilon": CLIP,
    "entropy_coeff": ENTROPY,
}


def unrolled(policy, batch):
    """Mean and deviation of the actions, one step after the other.

    A memory goes from step to step, begins with what the first step was given, and is forgotten where
    an episode starts.
    """
    if "recurrent_state" not in batch:
        params = policy.get_dist(batch.clone()).base_dist
        return params.loc, params.scale
    memory = batch["recurrent_state"][:, 0]
    found = []
    for step in range(batch.shape[1]):
        td = batch[:, step].select("target", "is_init")
        td["recurrent_state"] = torch.where(td["is_init"][..., None], 0.0, memory)
        params = policy.get_dist(td).base_dist
        memory = td["next", "recurrent_state"]
        found.append((params.loc, params.scale))
    return tuple(torch.stack(part, 1) for part in zip(*found))


def losses_by_hand(learner, batch, estimated, values):
    """Schulman et al. 2017, equation 9, with the entropy averaged over the two actions."""
    loc, scale = unrolled(learner.policy, batch)
    normal = Normal(loc, scale)
    ratio = (normal.log_prob(batch["action"]).sum(-1) - batch["action_log_prob"]).exp()
    advantage = (estimated - estimated.mean()) / estimated.std()
    clipped = ratio.clamp(1 - CLIP, 1 + CLIP)
    objective = torch.min(ratio * advantage, clipped * advantage).mean()
    predicted = learner.critic(batch.clone())["state_value"][..., 0]
    return {
        "loss_objective": -objective,
        "loss_entropy": -ENTROPY * normal.entropy().mean(),
        "loss_critic": (predicted - (estimated + values)).square().mean(),
    }, (ratio != clipped).float().mean()


@pytest.mark.parametrize("length", [None, 4, 3], ids=["no end", "length 4", "length 3"])
@pytest.mark.parametrize("network", ["mlp", "gru"])
def test_losses_and_gradients_are_those_of_the_formulas(experience, advantages, network, length):
    # The second batch begins in the middle of episodes, with a memory of what was before.
    learner, (_, batch) = experience(network, length, batches=2, **PLAIN)
    if network == "gru":
        assert batch["recurrent_state"][:, 0].abs().sum() > 0
    estimated, values = advantages(learner.critic, batch, GAMMA, LAMBDA)
    parameters = [*learner.policy.parameters(), *learner.critic.parameters()]
    expected, clipped = losses_by_hand(learner, batch, estimated, values)
    assert 0 < clipped < 1
    gradients = torch.autograd.grad(sum(expected.values()), parameters)
    before = [parameter.detach().clone() for parameter in parameters]
    metrics = learner.update(batch.clone())
    for name, loss in expected.items():
        assert metrics[name] == pytest.approx(loss.item(), rel=1e-4, abs=1e-6), name
    assert metrics["clip_fraction"] == pytest.approx(clipped.item(), abs=1e-6)
    assert metrics["mean_value"] == pytest.approx(values.mean().item(), rel=1e-5)
    for parameter, start, gradient in zip(parameters, before, gradients):
        assert gradient.abs().sum() > 0
        torch.testing.assert_close(start - parameter, gradient, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("network", ["mlp", "gru"])
@pytest.mark.parametrize("length", [None, 4])
def test_advantages_are_generalised_advantage_estimates(experience, advantages, network, length):
    learner, (batch,) = experience(network, length, gamma=GAMMA, gae_lambda=LAMBDA)
    estimated, values = advantages(learner.critic, batch, GAMMA, LAMBDA)
    learner.update(batch)
    torch.testing.assert_close(batch["advantage"][..., 0], estimated, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(batch["state_value"][..., 0], values)
    # The value target is the advantage plus the value, as in the report's section 2.5.
    torch.testing.assert_close(batch["value_target"], batch["advantage"] + batch["state_value"])


def test_what_is_terminated_is_worth_nothing_more(experience, advantages):
    learner, (batch,) = experience(gamma=GAMMA, gae_lambda=LAMBDA)
    ends = batch["next", "done"].clone()
    batch["next", "terminated"] = ends & (torch.arange(len(ends))[:, None, None] % 2 == 0)
    batch["next", "truncated"] = ends & ~batch["next", "terminated"]
    estimated, _ = advantages(learner.critic, batch, GAMMA, LAMBDA)
    learner.update(batch)
    torch.testing.assert_close(batch["advantage"][..., 0], estimated, rtol=1e-4, atol=1e-5)
