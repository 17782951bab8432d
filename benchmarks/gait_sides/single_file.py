"""PPO on one page, as many write it for themselves, on Gymnasium's ``AsyncVectorEnv``.

The settings are those of CleanRL's PPO for continuous actions: one robot would take 2,048 control steps
between updates there, here several share them.
"""

from __future__ import annotations

import dataclasses
import functools

import gymnasium
import mujoco
import numpy as np
import torch
from gymnasium.wrappers import vector
from torch import nn
from torch.distributions import Normal

from benchmarks.gait_sides import HISTORY, Hyperparameters, Task
from benchmarks.gait_sides.record import Recorder
from benchmarks.gymnasium_env import WalkAwayEnv
from benchmarks.rivals import START_METHOD


@dataclasses.dataclass(frozen=True)
class Settings(Hyperparameters):
    """All that decides how it learns.

    Attributes:
        critic_coeff: weight of the critic's loss.
        clip_values: whether the state value may leave the old one by no more than ``clip_epsilon``.
        max_grad_norm: longest gradient.
        adam_epsilon: Adam's.
        normalise: whether observations and rewards are scaled by their running deviation and clipped.
    """

    critic_coeff: float = 1.0
    clip_values: bool = False
    max_grad_norm: float = float("inf")
    adam_epsilon: float = 1e-8
    normalise: bool = False


DEFAULTS = Settings(
    num_envs=8,
    steps=256,
    iterations=1_000_000 // 2048,
    epochs=10,
    minibatch_size=64,
    learning_rate=3e-4,
    gamma=0.99,
    gae_lambda=0.95,
    clip_epsilon=0.2,
    entropy_coeff=0.0,
    hidden=(64, 64),
    critic_coeff=0.5,
    clip_values=True,
    max_grad_norm=0.5,
    adam_epsilon=1e-5,
    normalise=True,
)

#: Of normalised observations and rewards.
LARGEST = 10.0


class Agent(nn.Module):
    """Actor, critic, and a deviation for each hinge."""

    def __init__(self, size: int, actions: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.actor = _network(size, hidden, actions, gain=0.01)
        self.critic = _network(size, hidden, 1, gain=1.0)
        self.log_deviation = nn.Parameter(torch.zeros(actions))

    def distribution(self, seen: torch.Tensor) -> Normal:
        return Normal(self.actor(seen), self.log_deviation.exp(), validate_args=False)

    def value(self, seen: torch.Tensor) -> torch.Tensor:
        return self.critic(seen).squeeze(-1)


def _network(size: int, hidden: tuple[int, ...], out: int, gain: float) -> nn.Sequential:
    layers: list[nn.Module] = []
    for width in hidden:
        layers += [_linear(size, width, 2**0.5), nn.Tanh()]
        size = width
    return nn.Sequential(*layers, _linear(size, out, gain))


def _linear(size: int, out: int, gain: float) -> nn.Linear:
    layer = nn.Linear(size, out)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


class _Recorded(gymnasium.vector.VectorWrapper):
    """Records what the robots earn before anything scales it."""

    def __init__(self, env: gymnasium.vector.VectorEnv, recorder: Recorder) -> None:
        super().__init__(env)
        self._recorder = recorder

    def step(self, actions: np.ndarray) -> tuple:
        result = self.env.step(actions)
        self._recorder.add(result[1])
        return result


def make_env(task: Task, settings: Settings, recorder: Recorder) -> gymnasium.vector.VectorEnv:
    """The robots, a process each, with what is done to observations and rewards."""
    model = mujoco.MjModel.from_binary_path(task.model)
    make = functools.partial(WalkAwayEnv, model, HISTORY)
    env = gymnasium.vector.AsyncVectorEnv([make] * settings.num_envs, context=START_METHOD)
    env = _Recorded(env, recorder)
    if settings.normalise:
        env = vector.NormalizeObservation(env)
        env = vector.TransformObservation(env, lambda seen: np.clip(seen, -LARGEST, LARGEST))
        env = vector.NormalizeReward(env, gamma=settings.gamma)
        env = vector.TransformReward(env, lambda earned: np.clip(earned, -LARGEST, LARGEST))
    return env


def learn(task: Task, recorder: Recorder) -> None:
    ours = task.hyperparameters
    settings = DEFAULTS if ours is None else Settings(**dataclasses.asdict(ours.in_processes()))
    torch.manual_seed(task.seed)
    env = make_env(task, settings, recorder)
    seen, _ = env.reset(seed=task.seed)
    agent = Agent(seen.shape[-1], env.single_action_space.shape[-1], settings.hidden)
    optimizer = torch.optim.Adam(
        agent.parameters(), lr=settings.learning_rate, eps=settings.adam_epsilon
    )
    for iteration in range(settings.iterations):
        rate = settings.learning_rate * (1 - iteration / settings.iterations)
        for group in optimizer.param_groups:
            group["lr"] = rate
        batch, seen = collect(env, agent, seen, settings)
        for _ in range(settings.epochs):
            order = torch.randperm(len(batch["seen"]))
            for rows in order.split(settings.minibatch_size):
                minibatch = {name: value[rows] for name, value in batch.items()}
                loss = loss_of(agent, minibatch, settings)
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), settings.max_grad_norm)
                optimizer.step()
        recorder.end_iteration()
    env.close()


@torch.no_grad()
def collect(
    env: gymnasium.vector.VectorEnv, agent: Agent, seen: np.ndarray, settings: Settings
) -> tuple[dict[str, torch.Tensor], np.ndarray]:
    """Steps the robots; returns their experience, control steps in the first dimension, and what they see."""
    steps = []
    for _ in range(settings.steps):
        observed = torch.as_tensor(seen, dtype=torch.float32)
        distribution = agent.distribution(observed)
        action = distribution.sample()
        seen, earned, *_ = env.step(action.numpy())
        steps.append(
            {
                "seen": observed,
                "action": action,
                "log_prob": distribution.log_prob(action).sum(-1),
                "value": agent.value(observed),
                "earned": torch.as_tensor(earned, dtype=torch.float32),
            }
        )
    batch = {name: torch.stack([step[name] for step in steps]) for name in steps[0]}
    following = agent.value(torch.as_tensor(seen, dtype=torch.float32))
    batch["advantage"] = advantages(batch["earned"], batch["value"], following, settings)
    batch["return"] = batch["advantage"] + batch["value"]
    return {name: value.flatten(0, 1) for name, value in batch.items()}, seen


def advantages(
    earned: torch.Tensor, value: torch.Tensor, following: torch.Tensor, settings: Settings
) -> torch.Tensor:
    """Generalised advantage estimates of robots that are never reset, shape ``(steps, robots)``."""
    result, running = torch.empty_like(earned), torch.zeros_like(following)
    for step in reversed(range(len(earned))):
        surprise = earned[step] + settings.gamma * following - value[step]
        running = surprise + settings.gamma * settings.gae_lambda * running
        result[step], following = running, value[step]
    return result


def loss_of(agent: Agent, batch: dict[str, torch.Tensor], settings: Settings) -> torch.Tensor:
    """PPO's loss, all parts of it together."""
    distribution = agent.distribution(batch["seen"])
    ratio = (distribution.log_prob(batch["action"]).sum(-1) - batch["log_prob"]).exp()
    gain = batch["advantage"]
    gain = (gain - gain.mean()) / (gain.std() + 1e-8)
    epsilon = settings.clip_epsilon
    actor = -torch.minimum(gain * ratio, gain * ratio.clamp(1 - epsilon, 1 + epsilon)).mean()
    value = agent.value(batch["seen"])
    critic = (value - batch["return"]).square()
    if settings.clip_values:
        near = batch["value"] + (value - batch["value"]).clamp(-epsilon, epsilon)
        critic = torch.maximum(critic, (near - batch["return"]).square())
    entropy = distribution.entropy().sum(-1).mean()
    # The half is CleanRL's and belongs to its weight.
    half = 0.5 if settings.clip_values else 1.0
    return actor + settings.critic_coeff * half * critic.mean() - settings.entropy_coeff * entropy
