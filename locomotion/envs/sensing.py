"""The readings that an environment was asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch

from locomotion.envs.readings import Reading
from locomotion.options import readings as known_readings
from locomotion.tasks import RobotState


class Sensing(Mapping[str, Reading]):
    """Readings by name, in the order in which they were asked for.

    Copies find their readings by name, as these are functions of anybody's.

    Args:
        names: of the readings.

    Raises:
        ConfigError: for a reading that is not there.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._readings = {name: known_readings.get(name, "reading") for name in names}

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (list(self._readings),)

    def __getitem__(self, name: str) -> Reading:
        return self._readings[name]

    def __iter__(self):
        return iter(self._readings)

    def __len__(self) -> int:
        return len(self._readings)

    @property
    def needs_sensors(self) -> bool:
        """Whether a reading reads the model's sensors."""
        return any(reading.sensors for reading in self.values())

    def __call__(self, state: RobotState) -> dict[str, torch.Tensor]:
        """The readings of robots, by name; tensors of their own."""
        return {
            name: reading.read(state).to(getattr(torch, reading.dtype), copy=True)
            for name, reading in self.items()
        }
