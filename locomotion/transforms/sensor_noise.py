"""Sensors that are not exact."""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.utils import NestedKey
from torchrl.data import TensorSpec, Unbounded

from locomotion.transforms.keys import EntryTransform, as_keys, entry, require_floating


class SensorNoise(EntryTransform):
    """Adds Gaussian noise to entries, in place.

    Args:
        deviation: its standard deviation, in the unit of the entries.
        in_keys: the entries: a list of keys, or one, which may be nested.

    Raises:
        ValueError: if the deviation is negative or not a finite number; when added to an environment, if
            an entry does not hold floating point numbers.
        KeyError: when added to an environment, or used, where an entry of ``in_keys`` is not there.

    Examples:
        >>> from torchrl.envs import PendulumEnv, TransformedEnv
        >>> env = TransformedEnv(PendulumEnv(), SensorNoise(0.1, "th"))
        >>> env.rollout(5)["th"].shape
        torch.Size([5])
    """

    def __init__(
        self, deviation: float, in_keys: Sequence[NestedKey] | NestedKey = "hinge_position"
    ) -> None:
        if not isinstance(deviation, numbers.Real) or not 0 <= deviation < math.inf:
            raise ValueError(f"deviation must be a number of at least 0, got {deviation!r}")
        keys = as_keys(in_keys, "in_keys")
        super().__init__(in_keys=keys, out_keys=keys)
        self.deviation = deviation

    def _apply_transform(self, obs: torch.Tensor) -> torch.Tensor:
        return obs + self.deviation * torch.randn_like(obs)

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return self._call(tensordict_reset)

    def mirror_matrix(self, matrix: np.ndarray) -> np.ndarray:
        """The matrix that maps a noisy value to that of a mirror image; noise has no side."""
        return matrix

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        for key in self.in_keys:  # noise leaves any bounds
            spec = entry(observation_spec, key, self)
            require_floating(spec, key, self)
            observation_spec[key] = Unbounded(spec.shape, dtype=spec.dtype, device=spec.device)
        return observation_spec
