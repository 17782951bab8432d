"""Places and poses in which episodes start."""

from __future__ import annotations

import math

import torch

from locomotion.arenas.terrain import Terrain
from locomotion.robots.modular_robot import ModularRobot


def any_poses(
    robot: ModularRobot, count: int, share: float, generator: torch.Generator
) -> torch.Tensor:
    """Draws poses of the core with any heading, upright or overturned.

    Args:
        robot: whose lowest point is at height 0 with all hinges at 0.
        count: of poses.
        share: of those that are overturned, on average.
        generator: on the CPU.

    Returns:
        Place (m) and unit quaternion w x y z, float64 of shape ``(count, 7)``.
    """
    chances = torch.rand(count, 2, dtype=torch.float64, device="cpu", generator=generator)
    half, overturned = math.pi * chances[:, 0], chances[:, 1] < share
    cos, sin, zero = half.cos(), half.sin(), torch.zeros_like(half)
    upright = torch.stack([zero, zero, zero + robot.standing_height, cos, zero, zero, sin], -1)
    # Half a turn about the core's x axis comes first.
    over = torch.stack([zero, zero, zero + robot.overturned_height, zero, cos, sin, zero], -1)
    return torch.where(overturned[:, None], over, upright)


def upright_poses(robot: ModularRobot, count: int) -> torch.Tensor:
    """Poses of the core upright and facing along x, as :func:`any_poses` returns them."""
    pose = [0.0, 0.0, robot.standing_height, 1.0, 0.0, 0.0, 0.0]
    return torch.tensor(pose, dtype=torch.float64, device="cpu").repeat(count, 1)


def spread(
    poses: torch.Tensor, robot: ModularRobot, terrain: Terrain, generator: torch.Generator
) -> torch.Tensor:
    """Moves poses to random places of a period of the ground, above all of it that the robot reaches."""
    size = (len(poses), 2)
    drawn = torch.rand(size, dtype=torch.float64, device="cpu", generator=generator)
    xy = terrain.period * (drawn - 0.5)
    above = torch.from_numpy(terrain.highest(xy.numpy(), robot.reach))
    moved = poses.clone()
    moved[:, :2] += xy
    moved[:, 2] += above
    return moved
