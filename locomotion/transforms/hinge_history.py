"""A short memory: the last few values of an observation, side by side."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from tensordict import TensorDictBase
from tensordict.utils import NestedKey, unravel_key
from torchrl.data import TensorSpec, Unbounded
from torchrl.envs import CatFrames, Transform

from locomotion.transforms.keys import as_keys, entry, pairs_of_keys


class HingeHistory(Transform):
    """Stacks the last ``steps`` values of a vector, newest first, with zeros before the start.

    For an entry of shape ``(*batch, n)`` it writes one of shape ``(*batch, steps * n)``: first the
    current value, then the one a step ago, and so on. Made for hinge positions, it takes any vector.

    The memory is the transform's own, as that of :class:`~torchrl.envs.CatFrames` is: transforms that
    follow may scale, rename or drop the entry. It begins anew for the environments that are reset,
    alone or with others, and is part of ``state_dict()``.

    In a replay buffer it builds the same entries from stored trajectories whose last dimension is
    time, with :class:`~torchrl.envs.CatFrames`: it needs ``("next", "done")`` to see where
    trajectories end, fills the entries under ``"next"`` too where these are stored, and takes the
    first stored step for the start of a trajectory.

    Args:
        steps: how many values to stack; 1 copies the current one.
        in_keys: entries to remember: a list of keys, or one, which may be nested.
        out_keys: where their histories go; by default ``in_keys`` with ``_history`` appended.

    Raises:
        ValueError: if ``steps`` is not a whole number of at least 1, or the numbers of keys differ.
        KeyError: when used where an entry of ``in_keys`` is not there.

    Examples:
        >>> from torchrl.envs import PendulumEnv, TransformedEnv, UnsqueezeTransform
        >>> as_vector = UnsqueezeTransform(-1, in_keys=["th"], out_keys=["angle"])
        >>> env = TransformedEnv(PendulumEnv(), as_vector)
        >>> env = env.append_transform(HingeHistory(3, in_keys=["angle"]))
        >>> env.reset()["angle_history"].shape
        torch.Size([3])
    """

    def __init__(
        self,
        steps: int,
        in_keys: Sequence[NestedKey] | NestedKey = "hinge_position",
        out_keys: Sequence[NestedKey] | NestedKey | None = None,
    ) -> None:
        try:
            whole = operator.index(steps)
        except TypeError:
            whole = 0
        if whole < 1 or isinstance(steps, bool):
            raise ValueError(f"steps must be a whole number of at least 1, got {steps!r}")
        if out_keys is None:
            out_keys = [_renamed(key) for key in as_keys(in_keys)]
        in_keys, out_keys = pairs_of_keys(in_keys, out_keys)
        super().__init__(in_keys=in_keys, out_keys=out_keys)
        self.steps = whole
        self._memory: list[torch.Tensor | None] = [None] * len(in_keys)

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        for index, (in_key, out_key) in enumerate(zip(self.in_keys, self.out_keys)):
            value = self._vector(tensordict_reset, in_key)
            fresh = torch.cat([value, self._zeros(value)], -1)
            where = self._where(tensordict, in_key, value)
            memory = self._memory[index]
            if where is not None and memory is not None and memory.shape == fresh.shape:
                fresh = torch.where(where, fresh, memory.to(fresh.device))
            self._memory[index] = fresh
            tensordict_reset.set(out_key, fresh.clone())
        return tensordict_reset

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        for index, (in_key, out_key) in enumerate(zip(self.in_keys, self.out_keys)):
            value = entry(next_tensordict, in_key, self)
            memory, n = self._memory[index], value.shape[-1]
            if memory is None or memory.shape[:-1] != value.shape[:-1]:
                older = self._zeros(value)
            else:
                older = memory[..., : (self.steps - 1) * n].to(value.device)
            self._memory[index] = following = torch.cat([value, older], -1)
            next_tensordict.set(out_key, following.clone())
        return next_tensordict

    def _zeros(self, value: torch.Tensor) -> torch.Tensor:
        return value.new_zeros(*value.shape[:-1], (self.steps - 1) * value.shape[-1])

    def _vector(self, container: Any, key: NestedKey) -> Any:
        """An entry of a tensordict or of a spec; a number is refused."""
        found = entry(container, key, self)
        around = container if isinstance(key, str) else container.get(key[:-1])
        if found.ndim <= around.ndim:
            raise ValueError(
                f"HingeHistory: {key!r} is a number, not a vector; UnsqueezeTransform(-1) makes it one"
            )
        return found

    def _where(
        self, tensordict: TensorDictBase | None, in_key: NestedKey, value: torch.Tensor
    ) -> torch.Tensor | None:
        """The environments that are reset; ``None`` for all.

        Of the flags on the way to an entry the first one counts, as in TorchRL.
        """
        if tensordict is None:
            return None
        path = in_key[:-1] if isinstance(in_key, tuple) else ()
        for depth in range(len(path) + 1):
            key = unravel_key((*path[:depth], "_reset"))
            where = tensordict.get(key, None)
            if where is not None:
                flags = where.shape == value.shape[:-1] or where.shape[-1] != 1
                lead = where.shape if flags else where.shape[:-1]
                return where.reshape(*lead, *[1] * (value.ndim - len(lead)))
        return None

    def get_extra_state(self) -> dict[str, torch.Tensor]:
        """The memory, by the index of its entry; empty before the first reset."""
        memory = enumerate(self._memory)
        return {str(index): value.clone() for index, value in memory if value is not None}

    def set_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        for index in range(len(self.in_keys)):
            value = state.get(str(index))
            self._memory[index] = None if value is None else value.clone()

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Builds the histories of stored trajectories, batch shape ``(*batch, time)``."""
        keys = list(zip(self.in_keys, self.out_keys))
        if "next" in tensordict:
            following = [(_following(in_key), _following(out_key)) for in_key, out_key in keys]
            keys += [pair for pair in following if pair[0] in tensordict.keys(True)]
        oldest_first = CatFrames(
            N=self.steps,
            dim=-1,
            in_keys=[in_key for in_key, _ in keys],
            out_keys=[out_key for _, out_key in keys],
            padding="constant",
        )
        tensordict = oldest_first.unfolding(tensordict)
        for _, out_key in keys:
            stacked = tensordict.get(out_key).unflatten(-1, (self.steps, -1))
            tensordict.set(out_key, stacked.flip(-2).flatten(-2))
        return tensordict

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        for in_key, out_key in zip(self.in_keys, self.out_keys):
            spec = self._vector(observation_spec, in_key)
            observation_spec[out_key] = Unbounded(
                (*spec.shape[:-1], self.steps * spec.shape[-1]),
                dtype=spec.dtype,
                device=spec.device,
            )
        return observation_spec


def _renamed(key: NestedKey) -> NestedKey:
    return f"{key}_history" if isinstance(key, str) else (*key[:-1], f"{key[-1]}_history")


def _following(key: NestedKey) -> NestedKey:
    return unravel_key(("next", key))
