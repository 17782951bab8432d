"""The networks that a configuration can choose, ``conf/network/*.yaml``.

An architecture is a dataclass of its options with methods that make actor and critic. One of your own is
one more class here, or in a package of yours (see :mod:`locomotion.options.registry`). Torch is imported
when a network is made, so that options are checked before.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING

from locomotion.options import Checked, key, networks

if TYPE_CHECKING:
    from tensordict.nn import TensorDictModuleBase
    from tensordict.utils import NestedKey
    from torchrl.data import TensorSpec
    from torchrl.envs import Transform
    from torchrl.modules import ProbabilisticActor


@dataclasses.dataclass
class Network(Checked):
    """Base class of architectures."""

    PREFIX = "network."
    #: Whether the actor keeps a memory from step to step, so that it must learn from whole sequences.
    RECURRENT = False

    initial_deviation: float = key(
        "standard deviation of the actions at the start (rad)", default=1.0, above=0, most=100
    )

    def make_network(
        self, sizes: Mapping[NestedKey, int], out_features: int
    ) -> TensorDictModuleBase:
        """Makes the network of the actor.

        Args:
            sizes: length of each observation, by key.
            out_features: length of an action.

        Returns:
            A module that writes ``loc``, the mean action.
        """
        raise NotImplementedError

    def make_critic(self, sizes: Mapping[NestedKey, int]) -> TensorDictModuleBase:
        """Makes the state value, a module that writes ``state_value``, shape ``(*batch, 1)``."""
        raise NotImplementedError

    def make_actor(
        self, sizes: Mapping[NestedKey, int], action_spec: TensorSpec
    ) -> ProbabilisticActor:
        """Makes a Gaussian policy around the network of the actor."""
        from locomotion.agents.networks import GaussianActor

        network = self.make_network(sizes, action_spec.shape[-1])
        return GaussianActor(network, action_spec, self.initial_deviation)

    def make_transforms(self) -> list[Transform]:
        """Makes the transforms that the environment needs for the actor."""
        return []


def _gain() -> float:
    """The key of networks whose first mean actions can be made small."""
    return key(
        "factor of the initial weights of the layer that gives mean actions; near 0 all of these begin near 0",
        default=1.0,
        least=0,
        most=100,
    )


@networks.register("mlp")
@dataclasses.dataclass
class MLP(Network):
    """The report's network: a layer for each observation, then layers for all (section 2.3)."""

    width: int = key("width of each observation's own layer", default=32, least=1, most=65_536)
    hidden: list[int] = key("widths of the layers that follow", default=[32], least=1, most=65_536)
    initial_gain: float = _gain()

    def make_network(
        self, sizes: Mapping[NestedKey, int], out_features: int
    ) -> TensorDictModuleBase:
        from locomotion.agents.networks import ObservationModule

        return ObservationModule(
            sizes,
            "loc",
            out_features,
            width=self.width,
            hidden=self.hidden,
            gain=self.initial_gain,
        )

    def make_critic(self, sizes: Mapping[NestedKey, int]) -> TensorDictModuleBase:
        from locomotion.agents.networks import StateValue

        return StateValue(sizes, width=self.width, hidden=self.hidden)


@networks.register("gru")
@dataclasses.dataclass
class GRU(Network):
    """A recurrent policy: a layer for each observation, then a GRU that remembers.

    The critic is an MLP that sees the memory of the actor too.
    """

    RECURRENT = True

    width: int = key("width of each observation's own layer", default=32, least=1, most=65_536)
    hidden_size: int = key("size of the GRU's memory", default=64, least=1, most=65_536)
    layers: int = key("layers of the GRU", default=1, least=1, most=100)
    initial_gain: float = _gain()

    def make_network(
        self, sizes: Mapping[NestedKey, int], out_features: int
    ) -> TensorDictModuleBase:
        from locomotion.agents.networks import recurrent_network

        return recurrent_network(
            sizes,
            "loc",
            out_features,
            width=self.width,
            hidden_size=self.hidden_size,
            layers=self.layers,
            gain=self.initial_gain,
        )

    def make_critic(self, sizes: Mapping[NestedKey, int]) -> TensorDictModuleBase:
        from locomotion.agents.networks import RecurrentStateValue

        memory_size = self.layers * self.hidden_size
        return RecurrentStateValue(sizes, memory_size, width=self.width, hidden=[self.hidden_size])

    def make_transforms(self) -> list[Transform]:
        import torch
        from torchrl.data import Unbounded

        from locomotion.agents.networks import RECURRENT_STATE, EpisodeStart, Memory

        memory = Unbounded((self.layers, self.hidden_size), dtype=torch.float32, device="cpu")
        return [EpisodeStart(), Memory({RECURRENT_STATE: memory}, expand_specs=True)]
