"""Actor and critic of the report's section 2.3.

The modules here read and write tensordicts themselves instead of being wrapped in a
``TensorDictModule``: for networks this small the wrapper takes longer than the arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from tensordict.utils import NestedKey
from torch import nn
from torch.nn.functional import linear
from torchrl.data import Composite, TensorSpec
from torchrl.modules import IndependentNormal, ProbabilisticActor


class ObservationNet(nn.Module):
    """Encodes every observation by itself, then all of them together, and reads a vector off.

    Each observation goes through a linear layer of its own, what comes out is put side by side and
    goes through a second one, both followed by tanh; the last layer is linear.

    Args:
        sizes: length of each observation.
        out_features: length of the result.
        hidden_size: width of both hidden layers.
    """

    def __init__(self, sizes: Sequence[int], out_features: int, hidden_size: int = 32) -> None:
        super().__init__()
        self.encoders = nn.ModuleList(nn.Linear(size, hidden_size) for size in sizes)
        self.joint_encoder = nn.Linear(hidden_size * len(sizes), hidden_size)
        self.head = nn.Linear(hidden_size, out_features)

    def forward(self, observations: Sequence[torch.Tensor]) -> torch.Tensor:
        """Maps observations of shape ``(*batch, size)`` to ``(*batch, out_features)``."""
        first = observations[0]
        if first.is_cpu and first.numel() // first.shape[-1] >= 512:
            return self._by_sigmoids(observations)
        encoded = [encode(x) for encode, x in zip(self.encoders, observations)]
        return self.head(self.joint_encoder(torch.cat(encoded, -1).tanh()).tanh())

    def _by_sigmoids(self, observations: Sequence[torch.Tensor]) -> torch.Tensor:
        # tanh(x) = 2 sigmoid(2 x) - 1, with factors and shift moved into the layers around it. On
        # some CPUs torch's tanh takes several times as long as its sigmoid.
        encoded = [
            linear(x, 2 * encode.weight, 2 * encode.bias)
            for encode, x in zip(self.encoders, observations)
        ]
        x, joint, head = torch.cat(encoded, -1).sigmoid(), self.joint_encoder, self.head
        x = linear(x, 4 * joint.weight, 2 * (joint.bias - joint.weight.sum(-1))).sigmoid()
        return linear(x, 2 * head.weight, head.bias - head.weight.sum(-1))

    def side_by_side(self) -> Callable[[torch.Tensor], torch.Tensor]:
        """The same function of one tensor that holds all observations, ``(rows, sum(sizes))``.

        The encoders become one matrix with zeros between them, which for a few rows is faster. It
        is a copy: it does not follow the parameters as these change.
        """
        encoders = torch.block_diag(*(encode.weight for encode in self.encoders)).t()
        bias = torch.cat([encode.bias for encode in self.encoders])
        joint, head = self.joint_encoder, self.head

        def evaluate(observations: torch.Tensor) -> torch.Tensor:
            x = torch.addmm(bias, observations, encoders).tanh_()
            x = torch.addmm(joint.bias, x, joint.weight.t()).tanh_()
            return torch.addmm(head.bias, x, head.weight.t())

        return evaluate


class _ObservationModule(TensorDictModuleBase):
    """An :class:`ObservationNet` on the entries ``in_keys`` of a tensordict."""

    def __init__(
        self, observation_spec: Composite, in_keys: Sequence[NestedKey], out_features: int
    ) -> None:
        super().__init__()
        self.in_keys = list(in_keys)
        sizes = [observation_spec[key].shape[-1] for key in in_keys]
        self.net = ObservationNet(sizes, out_features)

    def evaluate(self, tensordict: TensorDictBase) -> torch.Tensor:
        return self.net([tensordict.get(key) for key in self.in_keys])


class GaussianParameters(_ObservationModule):
    """Mean, from the observations, and standard deviation, from a parameter vector, of actions.

    Writes ``loc`` and ``scale``, both of shape ``(*batch, num_actions)``. The standard deviation is
    the exponential of ``log_scale``, which starts at 0.
    """

    def __init__(
        self, observation_spec: Composite, in_keys: Sequence[NestedKey], num_actions: int
    ) -> None:
        super().__init__(observation_spec, in_keys, num_actions)
        self.out_keys = ["loc", "scale"]
        self.log_scale = nn.Parameter(torch.zeros(num_actions))

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        loc = self.evaluate(tensordict)
        tensordict.set("loc", loc)
        # Contiguous, because torch takes the logarithm of an expanded tensor five times as slowly.
        tensordict.set("scale", self.log_scale.exp().expand_as(loc).contiguous())
        return tensordict


class StateValue(_ObservationModule):
    """The expected return from the observations; writes ``state_value``, ``(*batch, 1)``."""

    def __init__(self, observation_spec: Composite, in_keys: Sequence[NestedKey]) -> None:
        super().__init__(observation_spec, in_keys, 1)
        self.out_keys = ["state_value"]

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        return tensordict.set("state_value", self.evaluate(tensordict))


def make_actor(
    observation_spec: Composite, action_spec: TensorSpec, in_keys: Sequence[NestedKey]
) -> ProbabilisticActor:
    """A Gaussian policy whose standard deviations do not depend on the state.

    Samples are not clipped, nor is their log-probability.

    Args:
        observation_spec: of the environment.
        action_spec: of the action, its last dimension the number of hinges.
        in_keys: observations that the policy sees, one encoder for each.
    """
    return ProbabilisticActor(
        GaussianParameters(observation_spec, in_keys, action_spec.shape[-1]),
        in_keys=["loc", "scale"],
        distribution_class=IndependentNormal,
        return_log_prob=True,
        spec=action_spec,
    )


def make_critic(observation_spec: Composite, in_keys: Sequence[NestedKey]) -> StateValue:
    """A state value with a network of its own, which shares nothing with the actor."""
    return StateValue(observation_spec, in_keys)
