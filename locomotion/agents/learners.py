"""The learners that a configuration can choose, ``conf/algorithm/*.yaml``.

A learner turns batches of experience into metrics and a better policy. Its options are a dataclass that
makes it; its keys stand under its own name, such as ``ppo.gamma``. One of your own is one more class here,
or in a package of yours (see :mod:`locomotion.options.registry`).
"""

from __future__ import annotations

import dataclasses
import enum
from typing import TYPE_CHECKING, Any

from locomotion.agents.base import Learner, LearnerConfig
from locomotion.options import ConfigError, key, learners

if TYPE_CHECKING:
    from torchrl.envs import EnvBase, Transform

    from locomotion.agents.architectures import Network
    from locomotion.tasks.options import EnvConfig


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
    symmetry: bool = key(
        "whether mirror images stand in for half of the frames that are learned from, or more of them where a"
        " body has several mirrors",
        default=False,
    )
    cudagraphs: bool = key(
        "whether a gradient step is one captured CUDA graph; needs cuda:0", default=False
    )

    def check(self, env: EnvConfig, device: str) -> None:
        super().check(env, device)
        frames = env.num_envs * self.steps
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
                f" iteration (env.num_envs={env.num_envs} x ppo.steps={self.steps})"
            )

    def check_network(self, network: Network) -> None:
        if self.symmetry and network.RECURRENT:
            raise ConfigError(
                "ppo.symmetry=True needs a network without a memory, such as network=mlp: a memory has no"
                " mirror image that is known"
            )
        if self.cudagraphs and network.RECURRENT:
            raise ConfigError(
                "ppo.cudagraphs=True needs a network without a memory, such as network=mlp: where"
                " episodes begin decides how a recurrent one computes, which a graph cannot follow"
            )

    def make(
        self, env: EnvBase, network: Network, in_keys: list[str], critic_keys: list[str]
    ) -> Learner:
        from locomotion.agents.mirroring import mirror_images
        from locomotion.agents.ppo import PPO
        from locomotion.transforms import RandomMirror

        def sizes(keys: list[str]) -> dict[str, int]:
            return {name: env.observation_spec[name].shape[-1] for name in keys}

        self.check_network(network)
        actor = network.make_actor(sizes(in_keys), env.action_spec)
        critic = network.make_critic(sizes(critic_keys))
        device = env.action_spec.device
        images = mirror_images(env, [*in_keys, *critic_keys]) if self.symmetry else []
        return PPO(
            actor.to(device),
            critic.to(device),
            self,
            num_actions=env.action_spec.shape[-1],
            frames=env.batch_size.numel() * self.steps,
            recurrent=network.RECURRENT,
            transform=RandomMirror(images) if images else None,
        )


@learners.register("cpg")
@dataclasses.dataclass
class CPGConfig(LearnerConfig):
    """Coupled oscillators that sense nothing, tuned by CMA-ES (Hansen 2016): what the field uses."""

    PREFIX = "cpg."

    population: int = key(
        "how many weights are tried in an iteration, each by as many robots",
        default=64,
        least=4,
        most=1_000_000,
    )
    deviation: float = key(
        "standard deviation of the weights at the start; an oscillator's own begins at 1, a coupling at 0",
        default=0.5,
        above=0,
        most=100,
    )
    frequency: float = key(
        "of a free oscillator whose weight is 1 (Hz)", default=1.0, above=0, most=100
    )
    reach: int = key(
        "hinges are coupled that are at most so many modules apart", default=2, least=0, most=1000
    )

    def check(self, env: EnvConfig, device: str) -> None:
        super().check(env, device)
        if env.num_envs % self.population:
            raise ConfigError(
                f"cpg.population={self.population} must divide env.num_envs={env.num_envs}, as all weights"
                " are tried by as many robots"
            )
        whole = round((env.time_limit or 0) * env.control_frequency)
        if self.steps != whole:
            raise ConfigError(
                f"cpg.steps={self.steps} must be the control steps of an episode, {whole} with"
                f" env.time_limit={env.time_limit} and env.control_frequency={env.control_frequency:g}"
            )
        if env.stagger:
            raise ConfigError(
                "env.stagger=True must be False with algorithm=cpg, whose robots start together"
            )

    def make_transforms(self, env: EnvBase, network: Network) -> list[Transform]:
        import torch
        from torchrl.data import Unbounded

        from locomotion.agents.networks import Memory
        from locomotion.agents.oscillators import OSCILLATORS

        neurons = Unbounded((2 * env.action_spec.shape[-1],), dtype=torch.float32, device="cpu")
        return [Memory({OSCILLATORS: neurons}, expand_specs=True)]

    def make(
        self, env: EnvBase, network: Network, in_keys: list[str], critic_keys: list[str]
    ) -> Learner:
        import torch

        from locomotion.agents.cma_es import CPG
        from locomotion.agents.oscillators import Oscillators, near_hinges

        task = getattr(env.base_env, "task", None)
        if task is None:
            raise ConfigError(
                "algorithm=cpg needs robots of a LocomotionEnv, whose bodies it knows"
            )
        policy = Oscillators(
            len(task.robot.hinges),
            near_hinges(task.robot.body, self.reach),
            task.control_timestep,
            task.target_limit,
            self.frequency,
        )
        seed = int(torch.randint(2**31, (), device="cpu"))
        num_envs = env.batch_size.numel()
        policy = policy.to(env.action_spec.device)
        return CPG(policy, num_envs, self.population, self.deviation, seed)
