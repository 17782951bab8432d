"""The physics that options ask for."""

from __future__ import annotations

import mujoco

from locomotion.physics.base import Physics
from locomotion.physics.batch import BatchPhysics
from locomotion.physics.bounds import Limits
from locomotion.physics.options import PhysicsBackend, PhysicsConfig


def make_physics(model: mujoco.MjModel, num_envs: int, config: PhysicsConfig) -> Physics:
    """Copies of a model, on the backend of the options.

    Raises:
        ConfigError: if this machine lacks the packages or the device for it.
    """
    config.require()
    limits = Limits(config.height_limit, config.speed_limit)
    if config.backend is PhysicsBackend.threaded:
        return BatchPhysics(model, num_envs, config.threads, limits)
    from locomotion.physics.warp import WarpPhysics  # an extra, which need not be installed

    return WarpPhysics(model, num_envs, config.device, config.contacts, limits)
