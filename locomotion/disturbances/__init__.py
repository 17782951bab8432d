"""Disturbances: one list of what a real robot brings, which training draws from and evaluation sets."""

from locomotion.disturbances.options import NONE, DisturbancesConfig

__all__ = ["NONE", "DisturbancesConfig"]
