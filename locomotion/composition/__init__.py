"""Hydra with the project's configuration: what is composed, how, and what a stranger's may not set."""

from locomotion.composition.application import application, own_store
from locomotion.composition.composed import composed
from locomotion.composition.sweeps import configurations

__all__ = ["application", "composed", "configurations", "own_store"]
