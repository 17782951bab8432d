"""How robots move: many copies of one compiled model, stepped together."""

from __future__ import annotations

import mujoco

from locomotion.config import PhysicsBackend, PhysicsConfig
from locomotion.physics.base import Physics
from locomotion.physics.threaded import ThreadedPhysics

__all__ = ["Physics", "ThreadedPhysics", "make_physics"]


def make_physics(model: mujoco.MjModel, num_envs: int, config: PhysicsConfig) -> Physics:
    """Copies of a model, stepped by what a configuration chooses.

    Raises:
        ConfigError: if this machine lacks the packages or the device for it.
    """
    config.require()
    if config.backend is PhysicsBackend.threaded:
        return ThreadedPhysics(model, num_envs, config.threads)
    from locomotion.physics.warp import WarpPhysics  # an extra, which need not be installed

    return WarpPhysics(model, num_envs, config.device, config.contacts)
