"""A short memory: the last few values of an observation, side by side."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from tensordict import TensorDictBase
from tensordict.utils import NestedKey, unravel_key
from torchrl.data import TensorSpec, Unbounded
from torchrl.envs import CatFrames, Transform


class HingeHistory(Transform):
    """Stacks the last ``steps`` values of a vector, newest first, with zeros before the start.

    For an entry of shape ``(*batch, n)`` it writes one of shape ``(*batch, steps * n)``: first the
    current value, then the one a step ago, and so on. Made for hinge positions, it takes any vector.

    The history travels in the tensordict, as a step count does, so the transform has no state of
    its own: a checkpoint of the data is a checkpoint of the history, and robots reset alone start
    from zeros alone. What :meth:`~torchrl.envs.EnvBase.step` is given must therefore carry the
    history that ``reset`` or the last step wrote.

    In a replay buffer it builds the same entries from stored trajectories whose last dimension is
    time, with :class:`~torchrl.envs.CatFrames`: it needs ``("next", "done")`` to see where
    trajectories end, fills the entries under ``"next"`` too where these are stored, and takes the
    first stored step for the start of a trajectory.

    Args:
        steps: how many values to stack; 1 copies the current one.
        in_keys: entries to remember.
        out_keys: where their histories go; by default ``in_keys`` with ``_history`` appended.

    Raises:
        ValueError: if ``steps`` is less than 1, or the numbers of keys differ.

    Examples:
        >>> from torchrl.envs import PendulumEnv, TransformedEnv
        >>> env = TransformedEnv(PendulumEnv(), UnsqueezeTransform(-1, ["th"], ["angle"]))
        >>> env.append_transform(HingeHistory(3, in_keys=["angle"]))
        >>> env.reset()["angle_history"].shape
        torch.Size([3])
    """

    def __init__(
        self,
        steps: int,
        in_keys: Sequence[NestedKey] = ("hinge_position",),
        out_keys: Sequence[NestedKey] | None = None,
    ) -> None:
        if steps < 1:
            raise ValueError(f"steps must be at least 1, got {steps}")
        in_keys = [unravel_key(key) for key in in_keys]
        if out_keys is None:
            out_keys = [_renamed(key) for key in in_keys]
        if len(out_keys) != len(in_keys):
            raise ValueError(f"got {len(in_keys)} in_keys but {len(out_keys)} out_keys")
        super().__init__(in_keys=in_keys, out_keys=out_keys)
        self.steps = steps

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        for in_key, out_key in zip(self.in_keys, self.out_keys):
            value = tensordict_reset.get(in_key)
            older = value.new_zeros(*value.shape[:-1], (self.steps - 1) * value.shape[-1])
            tensordict_reset.set(out_key, torch.cat([value, older], -1))
        return tensordict_reset

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        for in_key, out_key in zip(self.in_keys, self.out_keys):
            history = tensordict.get(out_key)
            following = torch.empty_like(history)
            self.write(next_tensordict.get(in_key), history, following)
            next_tensordict.set(out_key, following)
        return next_tensordict

    def write(self, value: torch.Tensor, history: torch.Tensor, out: torch.Tensor) -> None:
        """Writes the history that follows on another one, for loops that keep memory of their own.

        Args:
            value: what was observed, shape ``(*batch, n)``.
            history: what was remembered before, shape ``(*batch, steps * n)``.
            out: where the new history goes, shaped like ``history`` and apart from it.
        """
        n = value.shape[-1]
        out[..., :n] = value
        if self.steps > 1:
            out[..., n:] = history[..., :-n]

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
            spec = observation_spec[in_key]
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
