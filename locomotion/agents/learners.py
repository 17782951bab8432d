"""The learners that a configuration can choose, ``conf/algorithm/*.yaml``.

A learner turns batches of experience into metrics and a better policy. Its options are a dataclass that
makes it; its keys stand under its own name, such as ``ppo.gamma``. One of your own is one more class here,
or in a package of yours (see :mod:`locomotion.options.registry`).
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

from locomotion.options import Checked, ConfigError, key, learners

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from tensordict.nn import TensorDictModuleBase
    from torchrl.envs import EnvBase

    from locomotion.agents.architectures import Network

#: Most frames of an iteration; with a few hundred bytes each they fill a large machine's memory.
MOST_FRAMES = 2**27


class Learner(Protocol):
    """The training loop's view of a learner."""

    #: The policy that collects experience, and that a run is about.
    policy: TensorDictModuleBase

    def update(self, batch: TensorDictBase) -> Mapping[str, float]:
        """Learns from a batch of shape ``(num_envs, steps)``; returns metrics.

        ``mean_value`` among them has a column of its own in ``metrics.csv``.

        Raises:
            FloatingPointError: if what is learned is no longer a finite number.
        """
        ...

    def state_dict(self) -> dict[str, Any]:
        """All that it knows, apart from the policy."""
        ...

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Resumes from a state."""
        ...


@dataclasses.dataclass
class LearnerConfig(Checked):
    """Base class of learners' options: how much is collected, and for how long."""

    iterations: int = key(
        "rounds of collecting and learning", default=200, least=1, most=1_000_000_000
    )
    steps: int = key(
        "control steps each robot takes in an iteration", default=128, least=1, most=1_000_000
    )

    def check(self, num_envs: int, device: str) -> None:
        """Looks whether the options fit a number of robots and the device that they are on.

        Raises:
            ConfigError: if they do not.
        """
        if num_envs * self.steps > MOST_FRAMES:
            raise ConfigError(
                f"env.num_envs={num_envs} x {self.PREFIX}steps={self.steps} must be at most"
                f" {MOST_FRAMES} frames in an iteration"
            )

    def check_network(self, network: Network) -> None:
        """Looks whether the options fit an architecture.

        Raises:
            ConfigError: if they do not.
        """

    def make(
        self, env: EnvBase, network: Network, in_keys: list[str], critic_keys: list[str]
    ) -> Learner:
        """Makes the learner.

        Args:
            env: the environment, for its specs.
            network: the architecture.
            in_keys: the entries that the policy sees.
            critic_keys: the entries that a critic sees, those of the policy among them.
        """
        raise NotImplementedError


class Optimizer(enum.Enum):
    """The optimisers of torch that can be chosen."""

    adam = "adam"
    adamw = "adamw"
    rmsprop = "rmsprop"
    sgd = "sgd"


class Schedule(enum.Enum):
    """The course of the learning rates."""

    linear = "linear"
    constant = "constant"


@learners.register("ppo")
@dataclasses.dataclass
class PPOConfig(LearnerConfig):
    """Proximal policy optimisation (Schulman et al. 2017); the report's values (section 3.1)."""

    PREFIX = "ppo."

    epochs: int = key("passes over the data of an iteration", default=4, least=1, most=1_000_000)
    minibatch_size: int = key(
        "frames in a gradient step", default=2048, least=1, most=1_000_000_000
    )
    actor_lr: float = key("learning rate of the actor at the start", default=8e-4, above=0, most=10)
    critic_lr: float = key(
        "learning rate of the critic at the start", default=1e-3, above=0, most=10
    )
    schedule: Schedule = key(
        "of the learning rates: linear, to 0 after the last iteration, or constant",
        default=Schedule.linear,
    )
    optimizer: Optimizer = key("adam, adamw, rmsprop or sgd", default=Optimizer.adam)
    optimizer_options: dict[str, Any] = key(
        "of the optimiser, as torch names them, such as weight_decay", default={}
    )
    max_grad_norm: float | None = key(
        "longest gradient, of actor and critic each; null: any length", default=None, above=0
    )
    gamma: float = key("discount per control step", default=0.99, least=0, most=1)
    gae_lambda: float = key(
        "lambda of generalised advantage estimation", default=0.95, least=0, most=1
    )
    clip_epsilon: float = key(
        "how far the probability ratio may leave 1", default=0.2, above=0, most=0.99
    )
    entropy_coeff: float = key(
        "weight of the policy's entropy, averaged over the hinges", default=0.01, least=0, most=100
    )
    cudagraphs: bool = key(
        "whether a gradient step is one captured CUDA graph; needs cuda:0", default=False
    )

    def check(self, num_envs: int, device: str) -> None:
        super().check(num_envs, device)
        frames = num_envs * self.steps
        if self.cudagraphs and device != "cuda:0":
            raise ConfigError(
                f"ppo.cudagraphs=True needs physics.device=cuda:0, not {device};"
                " CUDA_VISIBLE_DEVICES says which GPU that is"
            )
        if self.cudagraphs and frames % self.minibatch_size:
            raise ConfigError(
                f"ppo.minibatch_size={self.minibatch_size} must divide the {frames} frames of an"
                " iteration with ppo.cudagraphs=True, as all minibatches of a graph have one size"
            )
        if self.minibatch_size > frames:
            raise ConfigError(
                f"ppo.minibatch_size={self.minibatch_size} must be at most the {frames} frames of an"
                f" iteration (env.num_envs={num_envs} x ppo.steps={self.steps})"
            )

    def check_network(self, network: Network) -> None:
        if self.cudagraphs and network.RECURRENT:
            raise ConfigError(
                "ppo.cudagraphs=True needs a network without a memory, such as network=mlp: where"
                " episodes begin decides how a recurrent one computes, which a graph cannot follow"
            )

    def make(
        self, env: EnvBase, network: Network, in_keys: list[str], critic_keys: list[str]
    ) -> Learner:
        from locomotion.agents.ppo import PPO

        def sizes(keys: list[str]) -> dict[str, int]:
            return {name: env.observation_spec[name].shape[-1] for name in keys}

        self.check_network(network)
        actor = network.make_actor(sizes(in_keys), env.action_spec)
        critic = network.make_critic(sizes(critic_keys))
        device = env.action_spec.device
        return PPO(
            actor.to(device),
            critic.to(device),
            self,
            num_actions=env.action_spec.shape[-1],
            frames=env.batch_size.numel() * self.steps,
            recurrent=network.RECURRENT,
        )
