"""Poses in which episodes start."""

from __future__ import annotations

import math

import torch

from locomotion.robots.modular_robot import ModularRobot


def start_poses(
    robot: ModularRobot, count: int, share: float, generator: torch.Generator
) -> torch.Tensor:
    """Draws poses of the core with any heading, upright or overturned.

    Args:
        robot: whose lowest point is on the ground with all hinges at 0.
        count: of poses.
        share: of those that are overturned, on average.
        generator: on the CPU.

    Returns:
        Height (m) and unit quaternion w x y z, float64 of shape ``(count, 5)``.
    """
    chances = torch.rand(count, 2, dtype=torch.float64, device="cpu", generator=generator)
    half, overturned = math.pi * chances[:, 0], chances[:, 1] < share
    cos, sin, zero = half.cos(), half.sin(), torch.zeros_like(half)
    upright = torch.stack([zero + robot.standing_height, cos, zero, zero, sin], -1)
    # Half a turn about the core's x axis comes first.
    over = torch.stack([zero + robot.overturned_height, zero, cos, sin, zero], -1)
    return torch.where(overturned[:, None], over, upright)
