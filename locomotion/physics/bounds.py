"""Bounds that a sound simulation does not leave."""

from __future__ import annotations

import dataclasses

import torch

from locomotion.physics.options import HEIGHT_LIMIT, SPEED_LIMIT

#: Bound of any other position or velocity (SI units).
MAX_STATE = 1000.0


@dataclasses.dataclass(frozen=True)
class Limits:
    """The motion that is believed of a robot; a simulation beyond it diverges.

    Attributes:
        height: of the core (m).
        speed: of the core along the ground, on average over a control step (m/s).
    """

    height: float = HEIGHT_LIMIT
    speed: float = SPEED_LIMIT


class Bounds:
    """The states to which some physics steps can lead a sound simulation.

    Args:
        limits: of height and speed.
        columns: times, positions and velocities in a row of states.
        timestep: length of a physics step (s).
        device: where states are.
    """

    def __init__(self, limits: Limits, columns: int, timestep: float, device: torch.device) -> None:
        self._limits = limits
        self._timestep = timestep
        # A state is compared with where it should be: time and place are known, the rest is around 0.
        self._known = torch.zeros(columns, dtype=torch.float64, device=device)
        self._known[:3] = 1.0
        self._made: dict[tuple[int, bool], tuple[torch.Tensor, torch.Tensor]] = {}

    def beyond(
        self, start: torch.Tensor, end: torch.Tensor, steps: int, passing: bool = False
    ) -> torch.Tensor:
        """Finds states that are not finite, or beyond the bounds.

        Args:
            start: times, positions and velocities before the steps, shape ``(num_envs, columns)``.
            end: those after them.
            steps: how many there were.
            passing: whether more steps follow, so that the limits of height and mean speed do not count yet.

        Returns:
            Shape ``(num_envs,)``.
        """
        if (steps, passing) not in self._made:
            self._made[steps, passing] = self._make(steps, passing)
        ahead, bound = self._made[steps, passing]
        off = torch.addcmul(ahead, start, self._known).sub_(end).abs_()
        return (off <= bound).all(1).logical_not_()  # in this form, so that nan is beyond

    def _make(self, steps: int, passing: bool) -> tuple[torch.Tensor, torch.Tensor]:
        bound = torch.full_like(self._known, MAX_STATE)
        bound[0] = self._timestep / 2
        if not passing:
            bound[1:3] = self._limits.speed * steps * self._timestep
            bound[3] = self._limits.height
        ahead = torch.zeros_like(self._known)
        ahead[0] = steps * self._timestep
        return ahead, bound
