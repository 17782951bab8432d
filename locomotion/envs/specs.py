"""The specs of an environment's entries."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torchrl.data import Binary, Bounded, Composite, TensorSpec, Unbounded

from locomotion.envs.readings import Reading
from locomotion.physics import Physics
from locomotion.tasks import WalkAway

#: Readings that an environment gives unless it is told others.
READINGS = ("hinge_position", "hinge_velocity", "core_orientation", "core_position")
#: Entries that say whether an episode ended, and why.
FLAGS = ("done", "terminated", "truncated")


def make_specs(
    task: WalkAway, readings: Mapping[str, Reading], num_envs: int, device: torch.device
) -> dict[str, TensorSpec]:
    """Makes the specs of a task, by the names that TorchRL's environments have for them.

    Args:
        task: the task.
        readings: what is observed, by name.
        num_envs: number of robots.
        device: where they are.
    """
    at, shape = {"device": device}, (num_envs, len(task.robot.hinges))
    limit = torch.tensor(task.target_limit, dtype=torch.float32, **at)
    observed = {
        name: Unbounded((num_envs, reading.size(task)), dtype=getattr(torch, reading.dtype), **at)
        for name, reading in readings.items()
    }
    flags = {name: Binary(1, shape=(num_envs, 1), dtype=torch.bool, **at) for name in FLAGS}
    return {
        "action_spec": Bounded(-limit, limit, shape=shape, dtype=torch.float32, **at),
        "observation_spec": Composite(observed, shape=(num_envs,), **at),
        "reward_spec": Unbounded((num_envs, 1), dtype=torch.float32, **at),
        "done_spec": Composite(flags, shape=(num_envs,), **at),
    }


def make_flags(physics: Physics) -> tuple[torch.Tensor, ...]:
    """Makes a flag for each of :data:`FLAGS`, none of which is raised, bool of shape ``(num_envs, 1)``."""
    shape = (len(FLAGS), physics.num_envs, 1)
    return torch.zeros(shape, dtype=torch.bool, device=physics.device).unbind()
