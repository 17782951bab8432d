"""A policy as a robot's computer runs it: readings in, hinge targets out, memory handed over."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import nn
from torchrl.envs import (
    ExplorationType,
    InitTracker,
    ObservationNorm,
    TensorDictPrimer,
    TransformedEnv,
    set_exploration_type,
)
from torchrl.modules import GRUModule, LSTMModule

from locomotion.config import Config
from locomotion.envs.observations import make_transforms
from locomotion.options import ConfigError
from locomotion.transforms import HingeHistory


class Controller(nn.Module):
    """The policy's mean action for one robot, with the transforms that write its observations.

    Args:
        config: the run.
        env: its environment.
        policy: its policy.

    Raises:
        ConfigError: if the environment has transforms of somebody's own, which a controller has not.

    Attributes:
        readings: the length of each reading that the policy needs, by name.
        memory: the shape of each part of the memory, by name; all of it is 0 at the start.
    """

    def __init__(self, config: Config, env: TransformedEnv, policy: TensorDictModuleBase) -> None:
        super().__init__()
        self._policy = _without_branches(policy)
        self._limit = config.env.target_limit
        self._transforms = nn.ModuleList(make_transforms(config.obs)[0])
        _require_known(env, self._transforms)
        spec, base = env.observation_spec, env.base_env.observation_spec
        self.readings = {name: base[name].shape[-1] for name in base}
        self.memory: dict[str, tuple[int, ...]] = {}
        for transform in self._transforms:
            if isinstance(transform, HingeHistory):
                (key,), length = transform.out_keys, spec[transform.out_keys[0]].shape[-1]
                self.memory[key] = (length - length // transform.steps,)
        # What a recurrent policy reads in one step is what it wrote for it in the step before.
        written = set(policy.out_keys)
        self._recurrent = [key for key in policy.in_keys if ("next", key) in written]
        self.memory |= {key: tuple(spec[key].shape[1:]) for key in self._recurrent}

    def forward(
        self, readings: Mapping[str, torch.Tensor], memory: Mapping[str, torch.Tensor]
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Decides.

        Args:
            readings: those of :attr:`readings` now, each of shape ``(length,)``.
            memory: that of the last time, with the shapes of :attr:`memory`.

        Returns:
            Hinge targets (rad), within the limits of the task, shape ``(hinges,)``; the memory for
            the next time.
        """
        seen, following = TensorDict(dict(readings)), {}
        for transform in self._transforms:
            (source,), (key,) = transform.in_keys, transform.out_keys
            if isinstance(transform, HingeHistory):
                seen[key] = torch.cat([seen[source], memory[key]])
                following[key] = seen[key][: len(memory[key])].clone()
            elif isinstance(transform, ObservationNorm):  # it asks a tensor how it normalises
                seen[key] = seen[source] * transform.scale + transform.loc
            else:
                seen = transform(seen)
        for key in self._recurrent:
            seen[key] = memory[key]
        with set_exploration_type(ExplorationType.DETERMINISTIC):
            decided = self._policy(seen)
        following |= {key: decided["next", key] for key in self._recurrent}
        return decided["action"].clamp(-self._limit, self._limit), following


def _require_known(env: TransformedEnv, known: Iterable[nn.Module]) -> None:
    memory = (InitTracker, TensorDictPrimer)  # of a recurrent policy
    others = [type(one).__name__ for one in env.transform if not isinstance(one, memory)]
    for transform in known:
        others.remove(type(transform).__name__)
    if others:
        raise ConfigError(f"a controller has not the environment's own {', '.join(others)}")


class _OneStep(TensorDictModuleBase):
    """A recurrent module of TorchRL's in a step that begins no episode.

    That module looks whether one begins, a branch that depends on data, which torch does not export.
    """

    def __init__(self, module: GRUModule | LSTMModule) -> None:
        super().__init__()
        self.in_keys = [key for key in module.in_keys if key != "is_init"]
        self.out_keys = list(module.out_keys)
        self.net = module.gru if isinstance(module, GRUModule) else module.lstm

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        value, *memory = (tensordict.get(key) for key in self.in_keys)
        state = [part.unsqueeze(1) for part in memory]  # (layers, 1, hidden_size)
        features, following = self.net(value[None, None], tuple(state) if state[1:] else state[0])
        following = following if isinstance(following, tuple) else (following,)
        tensordict.set(self.out_keys[0], features[0, 0])
        for key, part in zip(self.out_keys[1:], following, strict=True):
            tensordict.set(key, part.squeeze(1))
        return tensordict


def _without_branches(policy: TensorDictModuleBase) -> TensorDictModuleBase:
    policy = copy.deepcopy(policy)
    for parent in list(policy.modules()):
        for name, module in list(parent.named_children()):
            if isinstance(module, (GRUModule, LSTMModule)):
                setattr(parent, name, _OneStep(module))
    return policy
