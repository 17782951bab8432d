"""Trains with settings that the configuration does not have, to see what lies behind the report's findings.

``python -m benchmarks.variations NAME,... ARGUMENT ...`` takes, after the names of what to vary, what
``python -m locomotion.train`` takes:

- ``targets``: value targets are scaled to [0, 1] between the least and the greatest of each minibatch, as
  in the report's own runs;
- ``scale``: positions are divided by the root of how many are shown, so that a history weighs no more than
  one position;
- ``differences``: in place of older positions the policy sees how much the hinge moved in each step.

A run's record does not tell, so give it a folder of its own.
"""

from __future__ import annotations

import sys

import torch
from tensordict import TensorDict, TensorDictBase

from locomotion import agents, assembly
from locomotion.agents import PPO
from locomotion.command_line.training import launch
from locomotion.train import train
from locomotion.transforms import HingeHistory


class ScaledTargets(PPO):
    """PPO whose critic learns values between 0 and 1."""

    def _step(self, minibatch: TensorDictBase) -> TensorDict:
        target = minibatch["value_target"]
        low, high = target.min(), target.max()
        minibatch["value_target"] = (target - low) / (high - low)
        return super()._step(minibatch)


class ScaledHistory(HingeHistory):
    """Positions divided by the root of their number."""

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        tensordict_reset = super()._reset(tensordict, tensordict_reset)
        for key in self.out_keys:
            tensordict_reset.set(key, tensordict_reset.get(key) / self.steps**0.5)
        return tensordict_reset

    def write(self, value: torch.Tensor, history: torch.Tensor, out: torch.Tensor) -> None:
        super().write(value / self.steps**0.5, history, out)


class Differences(HingeHistory):
    """The position, then its change over the last step, over the one before, and so on."""

    def write(self, value: torch.Tensor, history: torch.Tensor, out: torch.Tensor) -> None:
        super().write(value, history, out)
        n = value.shape[-1]
        if self.steps > 1:
            out[..., n : 2 * n] = value - history[..., :n]


def targets() -> None:
    agents.PPO = ScaledTargets


def scale() -> None:
    assembly.HingeHistory = ScaledHistory


def differences() -> None:
    assembly.HingeHistory = Differences


VARIATIONS = {vary.__name__: vary for vary in (targets, scale, differences)}


if __name__ == "__main__":
    names = sys.argv.pop(1).split(",") if len(sys.argv) > 1 else [""]
    unknown = [name for name in names if name not in VARIATIONS]
    if unknown:
        print(f"error: {unknown[0]!r} must be one of {', '.join(VARIATIONS)}", file=sys.stderr)
        sys.exit(2)
    for name in names:
        VARIATIONS[name]()
    launch(train)
