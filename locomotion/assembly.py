"""What a configuration describes: the environment of a run, and the policy that walks in it."""

from __future__ import annotations

from torchrl.envs import Compose, TransformedEnv
from torchrl.modules import ProbabilisticActor

from locomotion.agents import make_actor
from locomotion.config import Config
from locomotion.envs import LocomotionEnv
from locomotion.transforms import HingeHistory, IncludeOrientation


def make_env(config: Config) -> TransformedEnv:
    """The environment of a run, with the entries that its policy sees."""
    observations = ["hinge_position"]
    transforms = [HingeHistory(config.obs.hinge_steps)]
    if config.obs.orientation is not None:
        observations.append("core_orientation")
        transforms.append(IncludeOrientation(config.obs.orientation.value))
    env = LocomotionEnv(
        config.robot,
        config.env.num_envs,
        physics=config.physics,
        control_frequency=config.env.control_frequency,
        settle_time=config.env.settle_time,
        time_limit=config.env.time_limit,
        target_limit=config.env.target_limit,
        observations=observations,
        seed=config.seed,
    )
    return TransformedEnv(env, Compose(*transforms))


def make_policy(config: Config, env: TransformedEnv) -> ProbabilisticActor:
    """The untrained policy of a run, where its robots are."""
    actor = make_actor(env.observation_spec, env.action_spec, policy_keys(config))
    return actor.to(config.physics.device)


def policy_keys(config: Config) -> list[str]:
    """The entries that the policy sees; each gets an encoder of its own."""
    orientation = [] if config.obs.orientation is None else ["orientation"]
    return ["hinge_position_history", *orientation]
