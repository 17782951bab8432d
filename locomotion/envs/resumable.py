"""An environment with transforms that can be saved and resumed."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any

import torch
from tensordict import TensorDictBase
from torchrl.envs import EnvBase, Transform, TransformedEnv


class ResumableEnv(TransformedEnv):
    """A :class:`~torchrl.envs.TransformedEnv` whose state holds all that its next step depends on.

    That is the base environment's ``state_dict()``, those of the transforms with the tensors that they
    keep elsewhere, and the entries that the last step or reset wrote. After :meth:`load_state_dict` the
    first ``reset()`` without arguments begins no episode: it returns the entries that were saved, so a
    collector that is made then goes on as if nothing had happened.

    It is to be stepped by ``step_and_maybe_reset()``, as collectors do. What a transform counts in plain
    numbers, as :class:`~torchrl.envs.TrajCounter` and :class:`~torchrl.envs.Timer` do, begins anew.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.__dict__["_current"] = None
        self.__dict__["_resumed"] = False
        super().__init__(*args, **kwargs)

    def step_and_maybe_reset(
        self, tensordict: TensorDictBase
    ) -> tuple[TensorDictBase, TensorDictBase]:
        stepped, following = super().step_and_maybe_reset(tensordict)
        self.__dict__["_current"] = following
        return stepped, following

    def reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        resumed, self.__dict__["_resumed"] = self._resumed, False
        if resumed and tensordict is None and not kwargs:
            return self._current.clone()
        self.__dict__["_current"] = super().reset(tensordict, **kwargs)
        return self._current

    def state_dict(self, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """The whole state, in tensors of its own; taken between two steps, after the first reset."""
        state = _state_of(self.base_env, self.transform)
        # A policy may read what it wrote itself, so nothing is left out.
        state["entries"] = self._current.exclude("next").to_dict()
        return copy.deepcopy(state)

    def load_state_dict(self, state_dict: Mapping[str, Any], **kwargs: Any) -> None:
        """Resumes from a state of :meth:`state_dict`.

        Raises:
            RuntimeError: if it is that of another environment, or of other transforms.
        """
        base, saved = self.base_env, state_dict["base"]
        while isinstance(base, TransformedEnv) and not isinstance(base, ResumableEnv):
            base, saved = base.base_env, saved["base"]
        base.load_state_dict(saved)  # opens one that was closed, so that it can be reset
        # Some transforms make what they remember in only when they are first used, as CatFrames does.
        with forked_generators(self), torch.no_grad():
            _ = self.input_spec
            current = super().reset()
        _load_into(self.base_env, self.transform, state_dict)
        self.__dict__["_current"] = current.update(state_dict["entries"])
        self.__dict__["_resumed"] = True


def forked_generators(env: EnvBase) -> AbstractContextManager[None]:
    """Puts torch's generators back after the block: the CPU's, and that of an environment's GPU.

    Left to itself torch would wake up all GPUs that there are.
    """
    on_gpu = env.device is not None and env.device.type == "cuda"
    return torch.random.fork_rng([env.device] if on_gpu else [])


def _state_of(env: EnvBase, transform: Transform) -> dict[str, Any]:
    # TorchRL's own state of a transformed environment lacks that of the one inside.
    nested = isinstance(env, TransformedEnv) and not isinstance(env, ResumableEnv)
    return {
        "base": _state_of(env.base_env, env.transform) if nested else env.state_dict(),
        "transforms": transform.state_dict(),
        "tensors": {f"{path}.{name}": value for path, name, value in _tensors_of(transform)},
    }


def _load_into(env: EnvBase, transform: Transform, state: Mapping[str, Any]) -> None:
    if isinstance(env, TransformedEnv) and not isinstance(env, ResumableEnv):
        _load_into(env.base_env, env.transform, state["base"])
    else:
        env.load_state_dict(state["base"])
    transform.load_state_dict(state["transforms"])
    for path, name, value in _tensors_of(transform):
        setattr(transform.get_submodule(path), name, state["tensors"][f"{path}.{name}"].to(value))


def _tensors_of(transform: Transform) -> list[tuple[str, str, torch.Tensor]]:
    """Tensors in plain attributes, which no ``state_dict()`` has: path of the module, name, tensor."""
    return [
        (path, name, value)
        for path, module in transform.named_modules()
        for name, value in vars(module).items()
        if isinstance(value, torch.Tensor)
    ]
