"""Our environment for learners that are not TorchRL's: observations side by side, in one tensor."""

from __future__ import annotations

import torch
from tensordict import TensorDictBase

from locomotion import compose
from locomotion.training.build import make_env, policy_keys


class OurRobots:
    """``LocomotionEnv`` with the observations of ``+obs=history3``.

    Args:
        robot: its name.
        num_envs: robots.
        seed: of their start.
    """

    def __init__(self, robot: str, num_envs: int, seed: int) -> None:
        config = compose(
            f"robot={robot}",
            "+obs=history3",
            f"env.num_envs={num_envs}",
            f"seed={seed}",
            # Of a learner that is not used here: an iteration must be no less than a minibatch.
            "ppo.minibatch_size=1",
        )
        self._env = make_env(config)
        self._keys = policy_keys(config)
        self._now = self._env.reset()
        self.num_envs = num_envs
        self.num_actions: int = self._env.action_spec.shape[-1]

    @property
    def observations(self) -> torch.Tensor:
        """The readings now, a new tensor of shape ``(num_envs, size)``."""
        return self._seen(self._now)

    def reset(self) -> torch.Tensor:
        """Puts all robots at their start; returns what they sense."""
        self._now = self._env.reset()
        return self.observations

    def set_state(self, qpos: torch.Tensor, qvel: torch.Tensor) -> None:
        """Puts all robots into a state, where they then start; what they sensed before is remembered."""
        self._env.base_env.set_state(qpos, qvel)

    def step(self, actions: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Steps all robots; those whose simulation diverged begin anew.

        Returns:
            Their rewards (m) and whether they diverged, each of shape ``(num_envs,)``, and what all of
            them sensed at the end of the step, before any began anew.
        """
        taken, self._now = self._env.step_and_maybe_reset(self._now.set("action", actions))
        after = taken["next"]
        return after["reward"].squeeze(-1), after["done"].squeeze(-1), self._seen(after)

    def close(self) -> None:
        self._env.close()

    def _seen(self, tensordict: TensorDictBase) -> torch.Tensor:
        return torch.cat([tensordict.get(key) for key in self._keys], -1)
