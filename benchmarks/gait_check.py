"""Whether all sides have the same task: our environment next to the Gymnasium environment of the others."""

from __future__ import annotations

import mujoco
import numpy as np
import torch

from benchmarks.gait_runs import Robot
from benchmarks.gait_sides import HISTORY
from benchmarks.gymnasium_env import WalkAwayEnv


def largest_difference(robot: Robot, steps: int = 20) -> float:
    """The differences of observations and rewards of a robot that does the same in both environments.

    Both begin in one state and are given the same targets, some of which are out of bounds. Observations
    count from where histories hold nothing from before.

    Args:
        robot: the robot.
        steps: control steps.
    """
    from benchmarks.gait_sides.our_robots import OurRobots

    model = mujoco.MjModel.from_binary_path(str(robot.model))
    theirs, ours = WalkAwayEnv(model, HISTORY), OurRobots(robot.name, 1, seed=0)
    theirs.reset(seed=0)
    ours.set_state(*map(torch.from_numpy, theirs.state))
    targets = np.random.default_rng(0).normal(0, 1, (steps, 1, model.nu)).astype(np.float32)
    apart = 0.0
    for step, target in enumerate(targets):
        seen, earned, *_ = theirs.step(target[0])
        rewards, _, sensed = ours.step(torch.from_numpy(target))
        apart = max(apart, abs(earned - float(rewards[0])))
        if step >= HISTORY:
            apart = max(apart, float(abs(seen - sensed[0].numpy()).max()))
    ours.close()
    return apart
