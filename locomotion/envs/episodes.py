"""The beginnings of episodes: place, heading and age."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from locomotion.tasks import RobotState


class Episodes:
    """The beginnings of the episodes of robots, a row each.

    Args:
        num_envs: number of robots.
        device: where they are.
        step_limit: control steps in an episode; ``None`` if it does not end.
        compass: whether robots sense the heading in the world, so that the one at the start is not kept.
        staggered: whether :meth:`stagger` does anything.

    Attributes:
        step_limit: as given.
        start: places of the cores on the ground (m), float64 of shape ``(num_envs, 2)``.
        heading: of the cores (rad), float64 of shape ``(num_envs,)``; ``None`` with a compass.
    """

    def __init__(
        self,
        num_envs: int,
        device: torch.device,
        step_limit: int | None,
        compass: bool,
        staggered: bool,
    ) -> None:
        self.step_limit = step_limit
        self._staggered = staggered and step_limit is not None
        self.start = torch.zeros(num_envs, 2, dtype=torch.float64, device=device)
        self.heading = None if compass else torch.zeros_like(self.start[:, 0])
        self._steps = torch.zeros(num_envs, dtype=torch.int64, device=device)

    def face(self, state: RobotState, rows: torch.Tensor | slice) -> None:
        """Notes the headings at which rows begin, for robots without a compass."""
        if self.heading is not None:
            self.heading[rows] = state.heading[rows]

    def begin(self, xy: torch.Tensor, rows: torch.Tensor | slice) -> None:
        """Begins the episodes of rows at places (m), shape ``(num_envs, 2)``."""
        self.start[rows] = xy[rows]
        self._steps[rows] = 0

    def stagger(self, generator: torch.Generator) -> None:
        """Puts each robot at a random time of its episode, so that they do not all end at once.

        Args:
            generator: on the CPU.
        """
        if self._staggered:
            size = self._steps.shape
            ages = torch.randint(self.step_limit, size, generator=generator, device="cpu")
            self._steps.copy_(ages)

    def step(self, truncated: torch.Tensor) -> None:
        """Counts a control step, and writes who has come to the time limit, shape ``(num_envs, 1)``."""
        if self.step_limit is not None:
            self._steps += 1
            truncated[:, 0] = self._steps >= self.step_limit

    def state_dict(self) -> dict[str, Any]:
        """All that it knows."""
        kept = {"start": self.start.clone(), "steps": self._steps.clone()}
        return kept if self.heading is None else {**kept, "heading": self.heading.clone()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continues from a state."""
        self.start.copy_(state["start"])
        self._steps.copy_(state["steps"])
        if self.heading is not None:
            self.heading.copy_(state["heading"])
