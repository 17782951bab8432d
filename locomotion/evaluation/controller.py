"""A policy as a robot's computer runs it: readings in, hinge targets out, memory handed over."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from tensordict import TensorDict
from torch import nn
from torchrl.envs import ExplorationType, TransformedEnv, set_exploration_type
from torchrl.modules import ProbabilisticActor

from locomotion.agents.networks import RECURRENT_STATE
from locomotion.config import Config
from locomotion.envs.observations import make_transforms
from locomotion.transforms import HingeHistory


class Controller(nn.Module):
    """The policy's mean action for one robot, with the transforms that write its observations.

    Args:
        config: the run.
        env: its environment.
        policy: its policy.

    Attributes:
        readings: the length of each reading that the policy needs, by name.
        memory: the shape of each part of the memory, by name; all of it is 0 at the start.
    """

    def __init__(self, config: Config, env: TransformedEnv, policy: ProbabilisticActor) -> None:
        super().__init__()
        self._policy = policy
        self._limit = config.env.target_limit
        self._transforms = nn.ModuleList(make_transforms(config.obs)[0])
        spec, base = env.observation_spec, env.base_env.observation_spec
        self.readings = {name: base[name].shape[-1] for name in base.keys()}
        self.memory: dict[str, tuple[int, ...]] = {}
        for transform in self._transforms:
            if isinstance(transform, HingeHistory):
                (key,), length = transform.out_keys, spec[transform.out_keys[0]].shape[-1]
                self.memory[key] = (length - length // transform.steps,)
        self._recurrent = RECURRENT_STATE in spec.keys()
        if self._recurrent:
            self.memory[RECURRENT_STATE] = tuple(spec[RECURRENT_STATE].shape[1:])

    def forward(
        self, readings: Mapping[str, torch.Tensor], memory: Mapping[str, torch.Tensor]
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Decides.

        Args:
            readings: those of :attr:`readings` now, each of shape ``(length,)``.
            memory: that of the last time, with the shapes of :attr:`memory`.

        Returns:
            Hinge targets (rad), within the limits of the task, shape ``(hinges,)``; the memory for
            the next time.
        """
        seen, following = TensorDict(dict(readings)), {}
        for transform in self._transforms:
            if isinstance(transform, HingeHistory):
                (source,), (key,) = transform.in_keys, transform.out_keys
                history = torch.cat([seen[source], memory[key]])
                seen[key], following[key] = history, history[: len(memory[key])].clone()
            else:
                seen = transform(seen)
        if self._recurrent:
            seen[RECURRENT_STATE] = memory[RECURRENT_STATE]
            seen["is_init"] = torch.zeros(1, dtype=torch.bool)
        with set_exploration_type(ExplorationType.DETERMINISTIC):
            decided = self._policy(seen)
        if self._recurrent:
            following[RECURRENT_STATE] = decided["next", RECURRENT_STATE]
        return decided["action"].clamp(-self._limit, self._limit), following
