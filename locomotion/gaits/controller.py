"""A policy as a robot's computer runs it: sensors in, hinge targets out, memory handed over."""

from __future__ import annotations

import torch
from torch import nn
from torchrl.envs import TransformedEnv
from torchrl.modules import ProbabilisticActor

from locomotion.transforms import HingeHistory, IncludeOrientation


class Controller(nn.Module):
    """The policy's mean action for one robot, with the transforms that it was trained behind.

    Args:
        env: the environment of the run, whose transforms are taken over.
        policy: the run's policy.

    Attributes:
        num_hinges: length of an action.
        history_length: numbers in the memory; zeros at the start.
        needs_orientation: whether the policy senses the core's orientation.
    """

    def __init__(self, env: TransformedEnv, policy: ProbabilisticActor) -> None:
        super().__init__()
        self._net = policy.module[0].net
        self._orientation = next(
            (part for part in env.transform if isinstance(part, IncludeOrientation)), None
        )
        (history,) = (part for part in env.transform if isinstance(part, HingeHistory))
        self._limit = env.action_spec.space.high.max().item()
        self.num_hinges = env.action_spec.shape[-1]
        self.history_length = (history.steps - 1) * self.num_hinges
        self.needs_orientation = self._orientation is not None

    def forward(
        self,
        hinge_position: torch.Tensor,
        history: torch.Tensor,
        core_orientation: torch.Tensor | None = None,
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Decides.

        Args:
            hinge_position: angles now (rad), shape ``(hinges,)``.
            history: the memory, shape ``(history_length,)``.
            core_orientation: unit quaternion w x y z, core to world, shape ``(4,)``; only for a policy
                that senses it.

        Returns:
            Hinge targets (rad), within the limits of the servos, shape ``(hinges,)``; the memory for
            the next time.
        """
        positions = torch.cat([hinge_position, history])
        observations = [positions]
        if core_orientation is not None and self._orientation is not None:
            observations.append(self._orientation._apply_transform(core_orientation))
        targets = self._net(observations).clamp(-self._limit, self._limit)
        return targets, positions[: self.history_length].clone()
