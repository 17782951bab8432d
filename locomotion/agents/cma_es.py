"""Weights of coupled oscillators, tuned by CMA-ES."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from cmaes import CMA
from tensordict import TensorDictBase

from locomotion.agents.oscillators import Oscillators


class CPG:
    """Tunes oscillators: in each iteration, one episode, every robot tries weights out.

    How good weights are is the mean reward of a control step; where a simulation diverged it counts as 0. The
    policy has the best weights of all that were tried.

    Args:
        policy: the oscillators.
        num_envs: number of robots.
        population: how many weights are tried in an iteration, each by as many robots.
        deviation: standard deviation of the weights at the start.
        seed: of the search.

    Attributes:
        policy: as given.
    """

    def __init__(
        self, policy: Oscillators, num_envs: int, population: int, deviation: float, seed: int
    ) -> None:
        self.policy = policy
        self._copies = num_envs // population
        self._begin = policy.weights.cpu().double().numpy()
        self._population, self._deviation, self._seed = population, deviation, seed
        self._restart()

    def _restart(self) -> None:
        self._search = CMA(
            mean=self._begin,
            sigma=self._deviation,
            seed=self._seed,
            population_size=self._population,
        )
        self._past: list[torch.Tensor] = []
        self._best = -np.inf
        self._ask()

    def _ask(self) -> None:
        self._tried = np.stack([self._search.ask() for _ in range(self._population)])
        each = self._weights(self._tried)
        self.policy.try_out(each.repeat_interleave(self._copies, 0))

    def _tell(self, rewards: torch.Tensor) -> None:
        self._past.append(rewards)
        values = rewards.numpy()
        best = int(values.argmax())
        if values[best] > self._best:
            self._best = float(values[best])
            self.policy.set_weights(self._weights(self._tried[best]))
        self._search.tell([(one, -value) for one, value in zip(self._tried, values, strict=True)])
        self._ask()

    def _weights(self, values: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(values).to(self.policy.weights)

    def update(self, batch: TensorDictBase) -> dict[str, float]:
        """Learns from the episodes of all robots.

        Args:
            batch: experience as a collector returns it, batch shape ``(num_envs, steps)``.

        Returns:
            The reward of the best weights so far, and how widely weights are spread.
        """
        rewards = batch["next", "reward"].squeeze(-1).double().mean(-1)
        diverged = batch["next", "terminated"].squeeze(-1).any(-1)
        rewards = torch.where(diverged, 0.0, rewards).reshape(self._population, self._copies)
        spread = float(self._tried.std(0).mean())
        self._tell(rewards.mean(-1).cpu())
        return {"best_reward": self._best, "deviation": spread}

    def state_dict(self) -> dict[str, Any]:
        """All rewards so far, of which everything else follows."""
        shape = (0, self._population)
        past = torch.stack(self._past) if self._past else torch.zeros(shape, dtype=torch.float64)
        return {"rewards": past, "seed": self._seed}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Resumes from a state."""
        self._seed = state_dict["seed"]
        self._restart()
        for rewards in state_dict["rewards"]:
            self._tell(rewards.cpu().clone())
