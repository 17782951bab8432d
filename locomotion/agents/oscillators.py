"""Coupled oscillators over a body's graph: a policy that senses nothing.

Each hinge has an oscillator of two neurons, which excite one another with opposite signs; the first neurons of
hinges that are near in the body are coupled likewise. The rate of change of all neurons together is so an
antisymmetric matrix times the neurons: their length stays what it is, and none grows without bound. That is the
central pattern generator of Revolve (Lan et al. 2021, Learning directed locomotion in modular robots with
evolvable morphologies), which integrates step by step what is exact here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import InteractionType, TensorDictModuleBase
from tensordict.nn.probabilistic import interaction_type

from locomotion.robots.body import Module

#: The memory of the policy.
OSCILLATORS = "oscillators"
#: Where all oscillators start, first and second neuron.
_START = (math.sqrt(0.5), -math.sqrt(0.5))


def near_hinges(body: Module, reach: int) -> list[tuple[int, int]]:
    """Pairs of hinges that are near in a body's tree.

    Args:
        body: the core, with the rest of the body below it.
        reach: from hinge to hinge, in steps from a module to a neighbour, at most.

    Returns:
        Pairs of numbers of hinges, in the order of the actions, the lower one first.
    """
    chains = {module.path: module.path.split("/") for module in body.walk()}
    hinges = [module.path for module in body.walk() if module.kind == "hinge"]

    def steps(one: str, other: str) -> int:
        shared = sum(
            1
            for _ in itertools.takewhile(
                lambda pair: pair[0] == pair[1], zip(chains[one], chains[other], strict=False)
            )
        )
        return len(chains[one]) + len(chains[other]) - 2 * shared

    pairs = itertools.combinations(range(len(hinges)), 2)
    return [pair for pair in pairs if steps(*(hinges[number] for number in pair)) <= reach]


class Oscillators(TensorDictModuleBase):
    """Coupled oscillators that set the targets of hinges.

    Reads the entry ``oscillators``, how far the neurons are from their start, of shape ``(*batch, 2 * hinges)``,
    and writes ``("next", "oscillators")`` and ``action``. Its parameters are ``weights``: of each hinge's own
    oscillator, then of each coupling, in units of the frequency.

    Args:
        hinges: number of hinges.
        couplings: pairs of hinges whose oscillators are coupled.
        period: time between two actions (s).
        limit: largest target (rad), where a first neuron is at 1 or beyond.
        frequency: of a free oscillator whose weight is 1 (Hz).
    """

    def __init__(
        self,
        hinges: int,
        couplings: Sequence[tuple[int, int]],
        period: float,
        limit: float,
        frequency: float,
    ) -> None:
        super().__init__()
        self.in_keys, self.out_keys = [OSCILLATORS], ["action", ("next", OSCILLATORS)]
        self._hinges, self._couplings = hinges, list(couplings)
        self._turn = 2 * math.pi * frequency * period
        self._limit = limit
        self._candidates: torch.Tensor | None = None
        where = {"dtype": torch.float32, "device": "cpu"}
        self.register_buffer("weights", torch.zeros(hinges + len(couplings), **where))
        self.register_buffer("start", torch.tensor(_START, **where).repeat_interleave(hinges))
        # Follows from the weights, so no checkpoint has it.
        steps = torch.eye(2 * hinges, **where)
        self.register_buffer("steps", steps, persistent=False)
        with torch.no_grad():
            self.weights[:hinges] = 1.0
            self.set_weights(self.weights.clone())

    def rates(self, weights: torch.Tensor) -> torch.Tensor:
        """The matrices that neurons are multiplied with for their change in a control step.

        Args:
            weights: shape ``(*batch, hinges + couplings)``.

        Returns:
            Antisymmetric matrices, shape ``(*batch, 2 * hinges, 2 * hinges)``; the first neurons of all
            hinges come first.
        """
        matrix = weights.new_zeros(*weights.shape[:-1], 2 * self._hinges, 2 * self._hinges)
        pairs = [(hinge, hinge + self._hinges) for hinge in range(self._hinges)] + self._couplings
        for number, (row, column) in enumerate(pairs):
            matrix[..., row, column] = weights[..., number] * self._turn
            matrix[..., column, row] = -weights[..., number] * self._turn
        return matrix

    def set_weights(self, weights: torch.Tensor) -> None:
        """Sets the weights that it walks with, shape ``(hinges + couplings,)``."""
        self.weights.copy_(weights)
        self.steps.copy_(self._exact(self.weights))

    def try_out(self, candidates: torch.Tensor) -> None:
        """Has each robot explore with weights of its own while it is trained.

        Args:
            candidates: shape ``(num_envs, hinges + couplings)``.
        """
        self._candidates = self._exact(candidates)

    def _exact(self, weights: torch.Tensor) -> torch.Tensor:
        return torch.linalg.matrix_exp(self.rates(weights.double())).to(self.steps)

    def load_state_dict(self, state_dict: Mapping[str, Any], *args: Any, **kwargs: Any) -> Any:
        found = super().load_state_dict(state_dict, *args, **kwargs)
        self.set_weights(self.weights.clone())
        return found

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        drawn = self.training and interaction_type() is InteractionType.RANDOM
        steps = self._candidates if drawn and self._candidates is not None else self.steps
        neurons = tensordict.get(OSCILLATORS) + self.start
        neurons = (steps @ neurons.unsqueeze(-1)).squeeze(-1)
        action = self._limit * neurons[..., : self._hinges].clamp(-1, 1)
        tensordict.set("action", action)
        return tensordict.set(("next", OSCILLATORS), neurons - self.start)
