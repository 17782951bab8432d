"""What a robot is paid for: walking away from where it started."""

from locomotion.envs.environment import Divergence, LocomotionEnv
from locomotion.envs.task import WalkAway

__all__ = ["Divergence", "LocomotionEnv", "WalkAway"]
