"""A short memory: the last few values of an observation, side by side."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.utils import NestedKey, unravel_key
from torchrl.data import TensorSpec, Unbounded
from torchrl.envs import EnvBase, TransformedEnv

from locomotion.transforms.keys import EntryTransform, as_keys, entry, pairs_of_keys, vector


class HingeHistory(EntryTransform):
    """Stacks the last ``steps`` values of a vector, newest first, with zeros before the start.

    For an entry of shape ``(*batch, n)`` it writes one of shape ``(*batch, steps * n)``: first the
    current value, then the one a step ago, and so on. Made for hinge positions, it takes any vector.

    The memory is the transform's own, as that of :class:`~torchrl.envs.CatFrames` is: transforms that
    follow may scale, rename or drop the entry. It begins anew for the environments that are reset,
    alone or with others, and is part of ``state_dict()``.

    In a replay buffer it keeps the histories that the environment has written and stored. They are
    right in slices of any length, wherever these begin; the steps before a slice cannot be known
    there. Where none is stored, it rebuilds them from whole trajectories: a dimension of the sample
    is named ``"time"``, each row of it begins where an episode begins, and ``"is_init"``, written by
    :class:`~torchrl.envs.InitTracker`, says where that is. Anything else is refused.

    Args:
        steps: how many values to stack; 1 copies the current one.
        in_keys: entries to remember: a list of keys, or one, which may be nested.
        out_keys: where their histories go; by default ``in_keys`` with ``_history`` appended.

    Raises:
        ValueError: if ``steps`` is not a whole number of at least 1, or the numbers of keys differ; when
            added to an environment, if an entry is a number; in a replay buffer, if histories cannot be
            known from a sample.
        KeyError: when added to an environment, or used, where an entry of ``in_keys`` is not there.

    Examples:
        >>> from torchrl.envs import PendulumEnv, TransformedEnv, UnsqueezeTransform
        >>> as_vector = UnsqueezeTransform(-1, in_keys=["th"], out_keys=["angle"])
        >>> env = TransformedEnv(PendulumEnv(), as_vector)
        >>> env = env.append_transform(HingeHistory(3, in_keys=["angle"]))
        >>> env.reset()["angle_history"].shape
        torch.Size([3])

        What was stored with its histories is sampled in slices, of which each step has its own:

        >>> from torchrl.data import LazyTensorStorage, ReplayBuffer, SliceSampler
        >>> sampler = SliceSampler(slice_len=5, end_key=("next", "done"))
        >>> buffer = ReplayBuffer(storage=LazyTensorStorage(40), sampler=sampler, batch_size=10)
        >>> _ = buffer.extend(env.rollout(40))
        >>> buffer.sample().reshape(-1, 5)["angle_history"].shape
        torch.Size([2, 5, 3])
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
            out_keys = [_renamed(key) for key in as_keys(in_keys, "in_keys")]
        in_keys, out_keys = pairs_of_keys(in_keys, out_keys)
        super().__init__(in_keys=in_keys, out_keys=out_keys)
        self.steps = whole
        #: By the index of the entry.
        self._memory: dict[int, torch.Tensor] = {}
        self._remember_of(None)

    def look(self, parent: TransformedEnv | None) -> None:
        super().look(parent)
        env = parent
        while isinstance(env, TransformedEnv):
            env = env.base_env
        if env is not None and env is not self._env:
            self._memory = {}
            self._remember_of(env)

    def _remember_of(self, env: EnvBase | None) -> None:
        """Notes whose values the memory holds.

        Clones share attributes. One that TorchRL makes to step the same environment, as that of
        FrameSkipTransform is, shares the memory too; one in another environment has its own.
        """
        self.__dict__["_env"] = env  # not a submodule

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        for index, in_key in enumerate(self.in_keys):
            value = vector(tensordict_reset, in_key, self)
            fresh = torch.cat([value, self._zeros(value)], -1)
            where = None if tensordict is None else _flags(tensordict, in_key, "_reset", value)
            memory = self._memory.get(index)
            if where is not None and memory is not None and memory.shape == fresh.shape:
                fresh = torch.where(where, fresh, memory.to(fresh.device))
            self._remember(index, fresh, tensordict_reset)
        return tensordict_reset

    def _reset_on_native_autoreset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        for index, (in_key, out_key) in enumerate(zip(self.in_keys, self.out_keys)):
            if in_key == out_key and index in self._memory:  # a history stands there already
                newest = self._memory[index].shape[-1] // self.steps
                tensordict_reset.set(in_key, tensordict_reset.get(in_key)[..., :newest])
        return self._reset(tensordict, tensordict_reset)

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        for index, in_key in enumerate(self.in_keys):
            value = entry(next_tensordict, in_key, self)
            memory, n = self._memory.get(index), value.shape[-1]
            if memory is None or memory.shape[:-1] != value.shape[:-1]:
                older = self._zeros(value)
            else:
                older = memory[..., : (self.steps - 1) * n].to(value.device)
            self._remember(index, torch.cat([value, older], -1), next_tensordict)
        return next_tensordict

    def _remember(self, index: int, history: torch.Tensor, tensordict: TensorDictBase) -> None:
        self._memory[index] = history
        tensordict.set(self.out_keys[index], history.clone())

    def _zeros(self, value: torch.Tensor) -> torch.Tensor:
        return value.new_zeros(*value.shape[:-1], (self.steps - 1) * value.shape[-1])

    def get_extra_state(self) -> dict[str, torch.Tensor]:
        """The memory, by the index of its entry; empty before the first reset."""
        return {str(index): value.clone() for index, value in self._memory.items()}

    def set_extra_state(self, state: Mapping[str, torch.Tensor]) -> None:
        self._memory.clear()
        self._memory.update({int(index): value.clone() for index, value in state.items()})

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Writes the histories that stored trajectories lack; see the class.

        Raises:
            KeyError: if an entry that is needed is not there.
            ValueError: if they cannot be known.
        """
        for in_key, out_key in zip(self.in_keys, self.out_keys):
            if in_key == out_key:
                raise ValueError(
                    f"HingeHistory: in_keys and out_keys are both {in_key!r}, so a replay buffer cannot"
                    " tell values from histories; give other out_keys"
                )
            if out_key not in tensordict.keys(True, True):
                self._rebuild(tensordict, in_key, out_key)
        return tensordict

    def _rebuild(self, tensordict: TensorDictBase, in_key: NestedKey, out_key: NestedKey) -> None:
        value = vector(tensordict, in_key, self)
        if "time" not in tensordict.names:
            raise ValueError(_unknown(in_key, "no dimension is named 'time'"))
        time = tensordict.names.index("time")
        starts = _flags(tensordict, in_key, "is_init", value)
        if starts is None:
            raise ValueError(_unknown(in_key, "no 'is_init' says where episodes begin"))
        following = tensordict.get(unravel_key(("next", in_key)), None)
        ends = _flags(tensordict, in_key, "done", value, "next")
        rows = [_time_last(part, time) for part in (value, starts, following, ends)]
        _require_whole(in_key, *rows)
        age = torch.arange(value.shape[time], device=value.device)
        age = age.reshape(-1, *[1] * (value.ndim - time - 1))
        age = age - torch.where(starts, age, 0).cummax(time).values
        past = [torch.where(age >= k, value.roll(k, time), 0) for k in range(self.steps)]
        history = torch.cat(past, -1)
        tensordict.set(out_key, history)
        if following is not None:
            older = history[..., : (self.steps - 1) * value.shape[-1]]
            tensordict.set(unravel_key(("next", out_key)), torch.cat([following, older], -1))

    def mirror_matrix(self, matrix: np.ndarray) -> np.ndarray:
        """The matrix that maps a history to that of a mirror image, from the one that maps a value."""
        return np.kron(np.eye(self.steps), matrix)

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        for in_key, out_key in zip(self.in_keys, self.out_keys):
            spec = vector(observation_spec, in_key, self)
            observation_spec[out_key] = Unbounded(
                (*spec.shape[:-1], self.steps * spec.shape[-1]),
                dtype=spec.dtype,
                device=spec.device,
            )
        return observation_spec


def _renamed(key: NestedKey) -> NestedKey:
    return f"{key}_history" if isinstance(key, str) else (*key[:-1], f"{key[-1]}_history")


def _flags(
    tensordict: TensorDictBase, in_key: NestedKey, name: str, value: torch.Tensor, *before: str
) -> torch.Tensor | None:
    """The flags of a name that hold for an entry, of its number of dimensions; ``None`` if there are none.

    Of the flags on the way to the entry the first one counts, as in TorchRL.
    """
    path = in_key[:-1] if isinstance(in_key, tuple) else ()
    for depth in range(len(path) + 1):
        flags = tensordict.get(unravel_key((*before, *path[:depth], name)), None)
        if flags is not None:
            plain = flags.shape == value.shape[:-1] or flags.shape[-1] != 1
            lead = flags.shape if plain else flags.shape[:-1]
            return flags.reshape(*lead, *[1] * (value.ndim - len(lead)))
    return None


def _time_last(part: Any, time: int) -> Any:
    return None if part is None else part.movedim(time, -1)


def _require_whole(
    in_key: NestedKey,
    value: torch.Tensor,
    starts: torch.Tensor,
    following: torch.Tensor | None,
    ends: torch.Tensor | None,
) -> None:
    """Raises a :class:`ValueError` if the steps before some step cannot be known; time is last."""
    if not starts[..., 0].all():
        raise ValueError(_unknown(in_key, "rows begin within episodes"))
    later = starts[..., 1:]
    broken = torch.zeros_like(later)
    if ends is not None:
        broken = broken | ends[..., :-1]
    if following is not None:
        # Where a slice borders on another one, what was stored as following is not what follows.
        one, other = following[..., :-1], value[..., 1:]
        differs = (one != other) & ~(one.isnan() & other.isnan())
        broken = broken | differs.any(-2, keepdim=True)
    if (broken & ~later).any():
        raise ValueError(_unknown(in_key, "a row holds parts of several episodes"))


def _unknown(in_key: NestedKey, why: str) -> str:
    return (
        f"HingeHistory: the history of {in_key!r} cannot be rebuilt, as {why}; store the one that the"
        " environment writes, or sample whole episodes with InitTracker's is_init as rows of a"
        " dimension named 'time'"
    )
