"""Trains with what no configuration describes, to see what lies behind the report's findings.

``python -m reproduction.variations NAME FOLDER [OVERRIDE ...]`` trains three seeds, each in a folder below
``FOLDER``, with one of two changes:

- ``targets``: value targets are scaled to [0, 1] between the least and the greatest of each minibatch, as
  in the report's own runs;
- ``differences``: in place of older positions the policy sees how far the hinges moved in each step.

Overrides are those of ``python -m locomotion.train``. A run's record does not tell of the change, so give
each a folder of its own.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torchrl.envs import EnvBase, UnaryTransform

from locomotion import compose, train
from locomotion.agents.base import Learner
from locomotion.cli.refusal import refusing
from locomotion.config import Config
from locomotion.options import ConfigError
from locomotion.training.build import make_learner


def targets(config: Config) -> dict[str, Any]:
    """Training whose critic learns values between 0 and 1."""

    def learner(env: EnvBase) -> Learner:
        ppo = make_learner(config, env)
        ppo.buffer.append_transform(_in_place("value_target", _between_0_and_1))
        return ppo

    return {"learner": learner}


def differences(config: Config) -> dict[str, Any]:
    """Training on the positions, and on their change over the last step, the one before, and so on."""
    steps = config.obs["hinge_position"].steps
    if steps == 1:
        raise ConfigError("differences need a history, such as +obs=history3")
    key = "hinge_position_history"
    return {"transforms": [_in_place(key, lambda history: _changes(history, steps))]}


VARIATIONS: dict[str, Callable[[Config], dict[str, Any]]] = {
    vary.__name__: vary for vary in (targets, differences)
}


def _in_place(key: str, change: Callable[[torch.Tensor], torch.Tensor]) -> UnaryTransform:
    return UnaryTransform([key], [key], fn=change)


def _between_0_and_1(values: torch.Tensor) -> torch.Tensor:
    low, high = values.aminmax()
    return (values - low) / (high - low)


def _changes(history: torch.Tensor, steps: int) -> torch.Tensor:
    values = history.unflatten(-1, (steps, -1))
    moved = values[..., :-1, :] - values[..., 1:, :]
    return torch.cat([values[..., :1, :], moved], -2).flatten(-2)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m reproduction.variations",
        description="Trains with what no configuration describes.",
    )
    parser.add_argument("name", choices=VARIATIONS, help="the change")
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="where the runs go")
    parser.add_argument("overrides", nargs="*", metavar="OVERRIDE", help="such as +obs=history3")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="SEED")
    arguments = parser.parse_intermixed_args()
    with refusing():
        for seed in arguments.seeds:
            config = compose(*arguments.overrides, f"seed={seed}")
            passed = VARIATIONS[arguments.name](config)
            result = train(config, arguments.folder / f"seed{seed}", **passed)
            print(f"{result.folder}: {result.reward:.4f} m per action at the end", flush=True)


if __name__ == "__main__":
    main()
