"""What a policy has learned: walking with it, and measuring how it walks."""

from locomotion.gaits.controller import Controller
from locomotion.gaits.measures import MEASURES, Interval, measure, summarise
from locomotion.gaits.policy import load_policy
from locomotion.gaits.reality import CHANGES, Change, Share, planned, shares
from locomotion.gaits.walking import Disturbances, Walk, Walker, make_walker, walk

__all__ = [
    "CHANGES",
    "MEASURES",
    "Change",
    "Controller",
    "Disturbances",
    "Interval",
    "Share",
    "Walk",
    "Walker",
    "load_policy",
    "make_walker",
    "measure",
    "planned",
    "shares",
    "summarise",
    "walk",
]
