"""Networks as the report draws them, and PPO that learns what it must."""

import pytest
import torch
from tensordict import TensorDict
from torchrl.collectors import Collector
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import EnvBase, ExplorationType, set_exploration_type

from locomotion.agents import PPO, make_actor, make_critic
from locomotion.agents.networks import ObservationNet
from locomotion.config import load

OBSERVATIONS = Composite(hinges=Unbounded((4, 18)), orientation=Unbounded((4, 4)), shape=(4,))
ACTION = Bounded(-1, 1, shape=(4, 6))
KEYS = ["hinges", "orientation"]


def parameters(module):
    return sum(parameter.numel() for parameter in module.parameters())


def test_networks_have_the_reports_layers():
    torch.manual_seed(0)
    actor, critic = make_actor(OBSERVATIONS, ACTION, KEYS), make_critic(OBSERVATIONS, KEYS)
    encoders = (18 * 32 + 32) + (4 * 32 + 32) + (64 * 32 + 32)
    assert parameters(critic) == encoders + 32 + 1
    assert parameters(actor) == encoders + 6 * 32 + 6 + 6  # six log standard deviations
    td = actor(OBSERVATIONS.rand())
    assert torch.equal(td["scale"], torch.ones(4, 6))
    assert critic(td)["state_value"].shape == (4, 1)


@pytest.mark.parametrize("rows", [4, 2048])
def test_a_network_is_the_function_that_its_layers_say(rows):
    # However many rows there are: large batches take another way through the activations.
    torch.manual_seed(0)
    net = ObservationNet([18, 4], 6)
    observations = [3 * torch.randn(rows, 18), torch.randn(rows, 4)]
    encoded = [encode(x) for encode, x in zip(net.encoders, observations)]
    joint = net.joint_encoder(torch.cat(encoded, -1).tanh())
    expected, result = net.head(joint.tanh()), net(observations)
    torch.testing.assert_close(result, expected)
    weight = torch.randn_like(expected)
    gradients = torch.autograd.grad((weight * result).sum(), list(net.parameters()))
    expected = torch.autograd.grad((weight * expected).sum(), list(net.parameters()))
    torch.testing.assert_close(gradients, expected, rtol=1e-4, atol=1e-4)


def test_log_probability_is_that_of_the_unclipped_sample():
    torch.manual_seed(0)
    actor = make_actor(OBSERVATIONS, ACTION, KEYS)
    with set_exploration_type(ExplorationType.RANDOM):
        td = actor(OBSERVATIONS.rand().expand(200, 4).clone())
    assert td["action"].abs().max() > 1
    expected = torch.distributions.Normal(td["loc"], td["scale"]).log_prob(td["action"]).sum(-1)
    torch.testing.assert_close(td["action_log_prob"], expected)


class Target(EnvBase):
    """Pays for hitting a target that the observation names; the best action is known."""

    def __init__(self, num_envs):
        super().__init__(batch_size=[num_envs])
        self.observation_spec = Composite(target=Unbounded((num_envs, 2)), shape=(num_envs,))
        self.action_spec = Unbounded((num_envs, 2))
        self.reward_spec = Unbounded((num_envs, 1))

    def _observe(self):
        self._target = torch.rand(self.num_envs, 2) - 0.5
        done = torch.zeros(self.num_envs, 1, dtype=torch.bool)
        content = {"target": self._target, "done": done, "terminated": done.clone()}
        return TensorDict(content, self.batch_size)

    def _reset(self, tensordict=None):
        return self._observe()

    def _step(self, tensordict):
        reward = -(tensordict["action"] - self._target).square().sum(-1, keepdim=True)
        return self._observe().set("reward", reward)

    def _set_seed(self, seed):
        torch.manual_seed(seed)

    @property
    def num_envs(self):
        return self.batch_size[0]


def ppo_config(**overrides):
    return load("ppo/report", {"steps": 32, "minibatch_size": 256, **overrides})


def test_ppo_finds_the_known_best_actions():
    torch.manual_seed(0)
    env = Target(32)
    config = ppo_config(iterations=40, gamma=0.0, actor_lr=5e-3, critic_lr=5e-3)
    actor = make_actor(env.observation_spec, env.action_spec, ["target"])
    critic = make_critic(env.observation_spec, ["target"])
    ppo = PPO(actor, critic, 2, 1024, config)
    for batch in Collector(env, actor, frames_per_batch=1024, total_frames=40 * 1024):
        ppo.update(batch)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        td = actor(env.reset())
    assert (td["action"] - td["target"]).abs().mean() < 0.05


def test_update_uses_the_configured_numbers():
    torch.manual_seed(0)
    env = Target(8)
    config = ppo_config(iterations=4, minibatch_size=64, entropy_coeff=0.5)
    actor = make_actor(env.observation_spec, env.action_spec, ["target"])
    critic = make_critic(env.observation_spec, ["target"])
    ppo = PPO(actor, critic, 2, 256, config)
    steps, rates = [], []
    ppo.optimizer.register_step_post_hook(lambda *_: steps.append(1))
    for batch in Collector(env, actor, frames_per_batch=256, total_frames=4 * 256):
        rates.append([group["lr"] for group in ppo.optimizer.param_groups])
        losses = ppo.update(batch)
    assert len(steps) == 4 * config.epochs * 256 // 64
    fractions = torch.tensor([1.0, 0.75, 0.5, 0.25])
    torch.testing.assert_close(
        torch.tensor(rates), fractions[:, None] * torch.tensor([config.actor_lr, config.critic_lr])
    )
    # The bonus averages over the two hinges, where TorchRL's entropy is their sum.
    assert losses["loss_entropy"].item() == pytest.approx(-0.5 * losses["entropy"].item() / 2)
    # The value target is the advantage plus the value, as in the report's section 2.5.
    torch.testing.assert_close(batch["value_target"], batch["advantage"] + batch["state_value"])
