"""The task as one would write it for TorchRL's ``DMControlWrapper``, which takes no composer's."""

from __future__ import annotations

import collections

import mujoco
import numpy as np
from dm_control.mujoco import Physics, wrapper
from dm_control.rl import control
from dm_control.suite import base
from torchrl.envs import DMControlWrapper

from benchmarks.task import CONTROL_TIMESTEP, SETTLE_TIME


class WalkAwayTask(base.Task):
    """One robot that walks away; rewards and observations are those of the Gymnasium environment."""

    def initialize_episode(self, physics: Physics) -> None:
        physics.set_control(self.random.uniform(-1, 1, physics.model.nu))
        physics.step(round(SETTLE_TIME / physics.timestep()))
        self._start = physics.data.qpos[:2].copy()
        self._distance = self._last_distance = 0.0

    def before_step(self, action: np.ndarray, physics: Physics) -> None:
        physics.set_control(np.clip(action, -1, 1))

    def after_step(self, physics: Physics) -> None:
        self._last_distance = self._distance
        self._distance = float(np.linalg.norm(physics.data.qpos[:2] - self._start))

    def get_observation(self, physics: Physics) -> collections.OrderedDict[str, np.ndarray]:
        return collections.OrderedDict(
            hinge_position=physics.data.qpos[7:].copy(),
            core_orientation=physics.data.qpos[3:7].copy(),
        )

    def get_reward(self, physics: Physics) -> float:
        return self._distance - self._last_distance


def make_env(model: mujoco.MjModel) -> DMControlWrapper:
    """The task on a compiled model, for TorchRL."""
    physics = Physics.from_model(wrapper.MjModel(model))
    return DMControlWrapper(
        control.Environment(physics, WalkAwayTask(), control_timestep=CONTROL_TIMESTEP)
    )
