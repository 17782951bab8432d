"""Trains with two settings of the report's own runs that the report does not argue for.

``python -m benchmarks.as_reported`` takes what ``python -m locomotion.train`` takes. Hinge targets are
clipped to 0.8 rad in place of 1, and value targets are scaled to [0, 1] between the least and the
greatest of each minibatch. This is to see whether either is behind what the report finds; a run's record
does not tell, so give it a folder of its own.
"""

from __future__ import annotations

from tensordict import TensorDict, TensorDictBase

from locomotion import agents
from locomotion.agents import PPO
from locomotion.cli import launch
from locomotion.envs import environment, task
from locomotion.train import train

TARGET_LIMIT = 0.8


class ReportedPPO(PPO):
    """PPO whose critic learns values between 0 and 1."""

    def _step(self, minibatch: TensorDictBase) -> TensorDict:
        target = minibatch["value_target"]
        low, high = target.min(), target.max()
        minibatch["value_target"] = (target - low) / (high - low)
        return super()._step(minibatch)


if __name__ == "__main__":
    agents.PPO = ReportedPPO
    environment.TARGET_LIMIT = task.TARGET_LIMIT = TARGET_LIMIT
    launch(train)
