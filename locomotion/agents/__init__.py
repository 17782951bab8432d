"""How a gait is learned: the networks, and PPO put together from TorchRL's parts."""

from locomotion.agents.networks import GaussianSampler, make_actor, make_critic
from locomotion.agents.ppo import PPO

__all__ = ["PPO", "GaussianSampler", "make_actor", "make_critic"]
