"""How a gait is learned: the networks, what collects experience, and PPO from TorchRL's parts."""

from locomotion.agents.collector import RolloutCollector
from locomotion.agents.networks import make_actor, make_critic
from locomotion.agents.ppo import PPO

__all__ = ["PPO", "RolloutCollector", "make_actor", "make_critic"]
