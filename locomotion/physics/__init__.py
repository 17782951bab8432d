"""How robots move: many copies of one compiled model, stepped together."""

from locomotion.physics.base import Physics
from locomotion.physics.threaded import ThreadedPhysics

__all__ = ["Physics", "ThreadedPhysics"]
