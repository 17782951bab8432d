"""The networks of actor and critic, and the policy around an actor's.

The modules here read and write tensordicts themselves instead of being wrapped in a
``TensorDictModule``: for networks this small the wrapper takes longer than the arithmetic.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import (
    InteractionType,
    TensorDictModule,
    TensorDictModuleBase,
    TensorDictSequential,
)
from tensordict.nn.probabilistic import interaction_type
from tensordict.utils import NestedKey
from torch import nn
from torchrl.data import TensorSpec
from torchrl.envs import InitTracker, TensorDictPrimer, Transform
from torchrl.modules import GRUModule, IndependentNormal, ProbabilisticActor

#: The memory of a recurrent policy.
RECURRENT_STATE = "recurrent_state"
#: Networks begin so whatever torch's defaults are, and so with the same weights.
_FACTORY = {"dtype": torch.float32, "device": torch.device("cpu")}


def make_head(in_features: int, out_features: int, gain: float = 1.0) -> nn.Linear:
    """Makes a linear layer whose initial weights and biases are torch's times a factor."""
    head = nn.Linear(in_features, out_features, **_FACTORY)
    with torch.no_grad():
        for parameter in head.parameters():
            parameter.mul_(gain)
    return head


class ObservationNet(nn.Module):
    """Encodes every observation by itself, then all of them together, and reads a vector off.

    Each observation goes through a linear layer of its own; the results, side by side, go through
    the hidden layers. Each of these is followed by tanh; the last layer is linear.

    Args:
        sizes: length of each observation.
        out_features: length of the result.
        width: width of each observation's own layer.
        hidden: widths of the layers that follow.
        gain: factor of the initial weights of the last layer.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        out_features: int,
        width: int = 32,
        hidden: Sequence[int] = (32,),
        gain: float = 1.0,
    ) -> None:
        super().__init__()
        self.encoders = nn.ModuleList(nn.Linear(size, width, **_FACTORY) for size in sizes)
        widths = [width * len(sizes), *hidden]
        self.joint = nn.ModuleList(
            nn.Linear(*pair, **_FACTORY) for pair in itertools.pairwise(widths)
        )
        self.head = make_head(widths[-1], out_features, gain)

    def forward(self, observations: Sequence[torch.Tensor]) -> torch.Tensor:
        """Maps observations of shape ``(*batch, size)`` to ``(*batch, out_features)``."""
        # Environments may give out places, or all they write, in float64.
        encoded = [
            encode(x.to(encode.weight.dtype)) for encode, x in zip(self.encoders, observations)
        ]
        x = torch.cat(encoded, -1).tanh()
        for layer in self.joint:
            x = layer(x).tanh()
        return self.head(x)


class ObservationModule(TensorDictModuleBase):
    """An :class:`ObservationNet` from entries of a tensordict to another one.

    Args:
        sizes: length of each entry that is read, by key.
        out_key: the entry that is written, shape ``(*batch, out_features)``.
        out_features: its length.
        options: width, hidden layers and gain of the network.
    """

    def __init__(
        self, sizes: Mapping[NestedKey, int], out_key: NestedKey, out_features: int, **options: Any
    ) -> None:
        super().__init__()
        self.in_keys = list(sizes)
        self.out_keys = [out_key]
        self.net = ObservationNet(list(sizes.values()), out_features, **options)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        result = self.net([tensordict.get(key) for key in self.in_keys])
        return tensordict.set(self.out_keys[0], result)


class GaussianParameters(TensorDictModuleBase):
    """Mean, from a network, and standard deviation, from a parameter vector, of actions.

    Writes ``loc`` and ``scale``, both of shape ``(*batch, num_actions)``. The standard deviation is
    the exponential of ``log_scale``.

    Args:
        network: writes ``loc``.
        num_actions: length of an action.
        initial_deviation: standard deviation at the start.
    """

    def __init__(
        self, network: TensorDictModuleBase, num_actions: int, initial_deviation: float = 1.0
    ) -> None:
        super().__init__()
        self.in_keys = network.in_keys
        self.out_keys = [*network.out_keys, "scale"]
        self.network = network
        start = torch.full((num_actions,), math.log(initial_deviation), **_FACTORY)
        self.log_scale = nn.Parameter(start)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        tensordict = self.network(tensordict)
        scale = self.log_scale.exp().expand_as(tensordict.get("loc"))
        # Contiguous, because torch takes the logarithm of an expanded tensor five times as slowly.
        return tensordict.set("scale", scale.contiguous())


class GaussianActor(ProbabilisticActor):
    """A Gaussian policy whose standard deviations do not depend on the state.

    Samples are not clipped, nor is their log-probability. It does what TorchRL's
    :class:`~torchrl.modules.ProbabilisticActor` does, without building a distribution for each step.

    Args:
        network: writes ``loc``, the mean action.
        action_spec: of the action, its last dimension the number of hinges.
        initial_deviation: standard deviation at the start (rad).
    """

    def __init__(
        self,
        network: TensorDictModuleBase,
        action_spec: TensorSpec,
        initial_deviation: float = 1.0,
    ) -> None:
        super().__init__(
            GaussianParameters(network, action_spec.shape[-1], initial_deviation),
            in_keys=["loc", "scale"],
            distribution_class=IndependentNormal,
            return_log_prob=True,
            spec=action_spec,
        )

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Writes the mean ``loc``, ``scale``, ``action`` and ``action_log_prob``."""
        tensordict = self.module[0](tensordict)
        loc, scale = tensordict.get("loc"), tensordict.get("scale")
        log_scale = self.module[0].log_scale
        if interaction_type() is InteractionType.RANDOM:
            noise = torch.randn_like(loc)
            action = torch.addcmul(loc, scale, noise)
            spread = noise.square().sum(-1)
        else:
            action, spread = loc.clone(), torch.zeros_like(loc[..., 0])
        constant = log_scale.sum() + 0.5 * math.log(2 * math.pi) * len(log_scale)
        tensordict.set("action", action)
        return tensordict.set("action_log_prob", (-0.5 * spread).sub_(constant))


class StateValue(ObservationModule):
    """The expected return from the observations; writes ``state_value``, ``(*batch, 1)``."""

    def __init__(self, sizes: Mapping[NestedKey, int], **options: Any) -> None:
        super().__init__(sizes, "state_value", 1, **options)


class RecurrentStateValue(StateValue):
    """A state value that sees the memory of a recurrent policy next to the observations."""

    def __init__(self, sizes: Mapping[NestedKey, int], memory_size: int, **options: Any) -> None:
        super().__init__({**sizes, RECURRENT_STATE: memory_size}, **options)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        *seen, memory = (tensordict.get(key) for key in self.in_keys)
        return tensordict.set("state_value", self.net([*seen, memory.flatten(-2)]))


class _OnOneDevice(Transform):
    """A transform of TorchRL's that makes tensors on the CPU where an environment names no device.

    By itself it would make them on torch's default device.
    """

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        with self.parent.device or torch.device("cpu"):
            return super().transform_observation_spec(observation_spec)

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        with self.parent.device or torch.device("cpu"):
            return super()._reset(tensordict, tensordict_reset)


class EpisodeStart(_OnOneDevice, InitTracker):
    """Writes ``is_init``, for a recurrent network: whether a step is the first one of an episode."""


class Memory(_OnOneDevice, TensorDictPrimer):
    """Writes the memory of a recurrent network at the start of an episode, zeros."""


def recurrent_network(
    sizes: Mapping[NestedKey, int],
    out_key: NestedKey,
    out_features: int,
    *,
    width: int,
    hidden_size: int,
    layers: int,
    gain: float = 1.0,
) -> TensorDictSequential:
    """A linear layer for each observation, a GRU over time, and a linear layer.

    Reads the entry ``recurrent_state`` and writes ``("next", "recurrent_state")``, each of shape
    ``(*batch, layers, hidden_size)``; needs ``is_init``, as
    :class:`EpisodeStart` writes it. The weights of the last layer begin as torch's times ``gain``.
    """
    encoder = ObservationModule(sizes, "embedding", hidden_size, width=width, hidden=())
    gru = nn.GRU(hidden_size, hidden_size, layers, batch_first=True, **_FACTORY)
    memory = GRUModule(
        gru=gru,
        in_keys=["embedding", RECURRENT_STATE],
        out_keys=["features", ("next", RECURRENT_STATE)],
    )
    head = TensorDictModule(make_head(hidden_size, out_features, gain), ["features"], [out_key])
    parts = TensorDictSequential(encoder, memory, head)
    return parts.select_out_keys(out_key, ("next", RECURRENT_STATE))
