"""A learner with a batch of experience of its own."""

import copy

import pytest
import torch
from torchrl.collectors import Collector
from torchrl.envs import Compose, TransformedEnv

from locomotion.agents.architectures import GRU, MLP
from locomotion.agents.learners import PPOConfig

ROBOTS, STEPS = 6, 10
NETWORKS = {
    "mlp": lambda: MLP(width=8, hidden=[8]),
    "gru": lambda: GRU(width=8, hidden_size=7, layers=2),
}


@pytest.fixture
def experience(target_env):
    """Makes a PPO learner, and batches that its policy collects while nothing is learned.

    Args:
        network: ``"mlp"`` or ``"gru"``.
        length: steps of an episode.
        batches: how many.
        options: of the learner.

    Returns:
        The learner and its batches, shape ``(ROBOTS, STEPS)``; between them the policy is changed a
        bit, so that probability ratios are not 1.
    """

    def make(network="mlp", length=4, batches=1, **options):
        torch.manual_seed(0)
        network = NETWORKS[network]()
        env = TransformedEnv(target_env(ROBOTS, length), Compose(*network.make_transforms()))
        settings = {"steps": STEPS, "minibatch_size": ROBOTS * STEPS, "epochs": 1, "iterations": 4}
        learner = PPOConfig(**{**settings, **options}).make(env, network, ["target"], ["target"])
        frames = ROBOTS * STEPS
        collector = Collector(
            env,
            copy.deepcopy(learner.policy),
            frames_per_batch=frames,
            total_frames=frames * batches,
            trust_policy=True,
        )
        collected = [batch.exclude("collector") for batch in collector]
        with torch.no_grad():
            for parameter in learner.policy.parameters():
                parameter.add_(0.1 * torch.randn_like(parameter))
        return learner, collected

    return make


@pytest.fixture
def advantages():
    """Generalised advantage estimates by the book (Schulman et al. 2016, equation 16).

    What a time limit cuts off is bootstrapped, what is terminated is not.
    """

    def estimate(critic, batch, gamma, lmbda):
        with torch.no_grad():
            values = critic(batch.clone())["state_value"][..., 0]
            following = critic(batch["next"].clone())["state_value"][..., 0]
        reward = batch["next", "reward"][..., 0]
        terminated = batch["next", "terminated"][..., 0]
        delta = reward + gamma * following * ~terminated - values
        expected, running = torch.zeros_like(delta), torch.zeros(len(delta))
        for step in reversed(range(delta.shape[1])):
            goes_on = ~batch["next", "done"][:, step, 0]
            running = delta[:, step] + gamma * lmbda * running * goes_on
            expected[:, step] = running
        return expected, values

    return estimate
