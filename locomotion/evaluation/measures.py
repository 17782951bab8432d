"""Measures of walking: one number a robot for each."""

from __future__ import annotations

import dataclasses
import math

import torch
from scipy import stats

from locomotion.evaluation.walking import Trajectory, upwards

#: The beginning of a walk (s), in which a gait gets going.
BEGINNING = 20.0
#: A walk's course is looked at in strides of this long (s); what is quicker is the gait itself.
STRIDE = 2.0


@dataclasses.dataclass(frozen=True)
class Interval:
    """A mean over robots and its 95% confidence interval."""

    mean: float
    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class Measure:
    """A measure: its unit and meaning, and whether it is yes or no for each robot."""

    unit: str
    meaning: str
    share: bool = False


MEASURES = {
    "speed": Measure("m/s", "distance over the time of the whole walk"),
    "first_speed": Measure("m/s", f"the same for the first {BEGINNING:g} s"),
    "steady_speed": Measure("m/s", f"the same for what comes after {BEGINNING:g} s"),
    "distance": Measure("m", "from where it started to where it ended"),
    "straightness": Measure("", "distance over length of path; 1 is a straight line"),
    "heading_drift": Measure("°/min", "how fast the direction of travel turns"),
    "work_per_metre": Measure("J/m", "of the hinges, either way, per metre of path"),
    "rolls_per_metre": Measure("1/m", "times the core rolls over per metre of path"),
    "on_back": Measure("", "share of robots whose core ended upside down", share=True),
    "diverged": Measure("", "share of robots whose simulation diverged", share=True),
}


def speed(place: torch.Tensor, seconds: float) -> torch.Tensor:
    """Speed away from the start: distance over time (m/s), shape ``(robots,)``.

    It is about all that time: of a robot that circles it is 0 after each turn, however it moves.

    Args:
        place: on the ground (m), at the start first and at the end last, shape ``(moments, robots, 2)``.
        seconds: the time between.
    """
    return (place[-1] - place[0]).norm(dim=-1) / seconds


def measure(walk: Trajectory) -> dict[str, torch.Tensor]:
    """The measures of each robot, by name, float64 of shape ``(robots,)``.

    Work and rolls are left out if the walk does not tell, and the speeds of its parts if it is over before
    :data:`BEGINNING`.

    - Path: the length of the line through where the core was every :data:`STRIDE` seconds.
    - Heading drift: the angle between the way gone in the first half and in the second, over half the
      time, as the two are half the time apart.
    - Rolls: half the times that the core turned over, from upright to upside down or back, as
      rolling over once takes two.

    A robot whose simulation diverged has nan for all but ``diverged``, and one that did not move for
    what is measured per metre.
    """
    seconds = walk.period * (len(walk.position) - 1)
    place = walk.position[..., :2]
    distance = (place[-1] - place[0]).norm(dim=-1)
    stride = max(1, round(STRIDE / walk.period))
    marks = torch.cat([place[:-1:stride], place[-1:]])
    path = marks.diff(dim=0).norm(dim=-1).sum(0)
    path[path == 0] = math.nan  # nothing can be said per metre
    half = len(place) // 2
    first, second = place[half] - place[0], place[-1] - place[half]
    found = {
        "speed": speed(place, seconds),
        **_parts(place, walk.period),
        "distance": distance,
        "straightness": distance / path,
        "heading_drift": math.degrees(1) * _angle(first, second) / (seconds / 120),
    }
    if walk.work is not None and walk.overturns is not None:
        found["work_per_metre"] = walk.work.sum(0) / path
        found["rolls_per_metre"] = walk.overturns.sum(0) / 2 / path
    found["on_back"] = (upwards(walk.orientation[-1]) < 0).double()
    for value in found.values():
        value[walk.diverged] = math.nan
    found["diverged"] = walk.diverged.double()
    return found


def _parts(place: torch.Tensor, period: float) -> dict[str, torch.Tensor]:
    turn = round(BEGINNING / period)
    if turn >= len(place) - 1:
        return {}
    rest = (len(place) - 1 - turn) * period
    return {
        "first_speed": speed(place[: turn + 1], turn * period),
        "steady_speed": speed(place[turn:], rest),
    }


def _angle(one: torch.Tensor, other: torch.Tensor) -> torch.Tensor:
    """Between vectors on the ground, ``(robots, 2)``, from 0 to pi."""
    cross = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return torch.atan2(cross.abs(), (one * other).sum(-1))


def summarise(values: dict[str, torch.Tensor]) -> dict[str, Interval]:
    """Means over robots with 95% confidence intervals.

    By Student's t, and by Wilson's score for shares of robots. What is unknown is left out.

    Args:
        values: what :func:`measure` returns.
    """
    return {name: _interval(name, value[~value.isnan()]) for name, value in values.items()}


def _interval(name: str, values: torch.Tensor) -> Interval:
    count = len(values)
    if not count:
        return Interval(math.nan, math.nan, math.nan)
    mean = values.mean().item()
    if MEASURES[name].share:
        found = stats.binomtest(round(mean * count), count)
        bounds = found.proportion_ci(method="wilson")
        return Interval(mean, float(bounds.low), float(bounds.high))
    if count == 1:
        return Interval(mean, math.nan, math.nan)
    half = stats.t.ppf(0.975, count - 1) * values.std().item() / math.sqrt(count)
    return Interval(mean, mean - half, mean + half)
