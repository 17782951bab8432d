"""Targets on their way from a policy to the hinges: those that get lost, gears with play, a hinge that is stuck."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from locomotion.disturbances.draws import Draws


class Commands:
    """Turns the targets that a policy asks for into those that the gears follow.

    A gear with play follows its motor once that has moved by half of it to either side: the play operator,
    in which the arm rests where the gear left it. That is right for arms that friction holds, and leaves
    out how they rattle. A hinge that is stuck is sent to the angle that it had when it was drawn.

    Args:
        draws: what is drawn.
        limit: targets are clipped to so much to either side (rad).
        shape: robots and hinges.
        device: where they are.

    Attributes:
        asked: the targets that the policy last asked for, as clipped (rad), shape ``(num_envs, hinges)``.
    """

    def __init__(
        self, draws: Draws, limit: float, shape: tuple[int, int], device: torch.device
    ) -> None:
        self._draws = draws
        self._limit = limit
        self.asked = torch.zeros(shape, dtype=torch.float64, device=device)
        self._received = torch.zeros_like(self.asked)
        self._followed = torch.zeros_like(self.asked)
        self._stuck_at = torch.zeros_like(self.asked)

    def hold(self, angles: torch.Tensor) -> None:
        """Notes the hinges' angles (rad), at which those that have just been drawn are stuck."""
        self._stuck_at.copy_(angles)

    def begin(self, targets: torch.Tensor, rows: torch.Tensor | slice) -> torch.Tensor:
        """Begins the episodes of rows under targets that get through; returns what the gears follow."""
        for kept in (self.asked, self._received, self._followed):
            kept[rows] = targets[rows].clamp(-self._limit, self._limit)
        return self._held(targets)

    def send(self, targets: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """Sends targets (rad) for a control step.

        Args:
            targets: what the policy asks for, shape ``(num_envs, hinges)``.
            generator: draws whose are lost.

        Returns:
            What the gears follow, of the same shape.
        """
        draws, wrong = self._draws, ~targets.isfinite()
        clipped = targets.to(self.asked.dtype).clamp(-self._limit, self._limit)
        self.asked.copy_(clipped.nan_to_num(0.0))
        received = self.asked
        if "dropped" in draws:
            chance = torch.rand(
                len(received), 1, generator=generator, dtype=received.dtype, device=received.device
            )
            received = torch.where(chance < draws["dropped"], self._received, received)
        self._received.copy_(received)
        if "backlash" in draws:
            half = draws["backlash"] / 2
            received = self._followed.clamp(received - half, received + half)
        self._followed.copy_(received)
        received = self._held(received)
        # Physics is to see what was no number, and puts the robot back for it.
        return torch.where(wrong, targets, received.to(targets.dtype))

    def _held(self, targets: torch.Tensor) -> torch.Tensor:
        if "stuck" not in self._draws:
            return targets
        return torch.where(self._draws["stuck"] > 0, self._stuck_at, targets)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """All that decides what comes next."""
        return {name: value.clone() for name, value in self._kept().items()}

    def load_state_dict(self, state: Mapping[str, torch.Tensor]) -> None:
        """Continues from a state."""
        for name, value in self._kept().items():
            value.copy_(state[name])

    def _kept(self) -> dict[str, torch.Tensor]:
        return {
            "asked": self.asked,
            "received": self._received,
            "followed": self._followed,
            "stuck_at": self._stuck_at,
        }
