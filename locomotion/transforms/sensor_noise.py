"""Sensors that are not exact."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from tensordict import TensorDictBase
from tensordict.utils import NestedKey
from torchrl.envs import ObservationTransform

from locomotion.transforms.keys import as_keys


class SensorNoise(ObservationTransform):
    """Adds Gaussian noise to entries, in place.

    Args:
        deviation: its standard deviation, in the unit of the entries.
        in_keys: the entries: a list of keys, or one, which may be nested.
    """

    def __init__(
        self, deviation: float, in_keys: Sequence[NestedKey] | NestedKey = "hinge_position"
    ) -> None:
        keys = as_keys(in_keys)
        super().__init__(in_keys=keys, out_keys=keys)
        self.deviation = deviation

    def _apply_transform(self, obs: torch.Tensor) -> torch.Tensor:
        return obs + self.deviation * torch.randn_like(obs)

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return self._call(tensordict_reset)
