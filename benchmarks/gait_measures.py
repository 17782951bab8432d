"""Measures of learning curves: when a robot walks, and how well at a given time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from benchmarks.gait_runs import Run

#: Control steps over which rewards are averaged, for every side; the report's iteration has as many.
WINDOW = 8192


@dataclasses.dataclass(frozen=True)
class Curve:
    """The learning curve of a run, at the ends of its iterations.

    A point is the mean reward over the last :data:`WINDOW` control steps, so that sides whose iterations
    differ in size are averaged alike. Where a window begins within an iteration, the iteration's control
    steps count with its mean. The first point is there once a window is full.

    Attributes:
        seconds: since the process was started, shape ``(points,)``.
        steps: control steps of all robots until then, shape ``(points,)``.
        rewards: mean rewards of a control step (m), shape ``(points,)``.
    """

    seconds: np.ndarray
    steps: np.ndarray
    rewards: np.ndarray

    @classmethod
    def of(cls, run: Run) -> Curve:
        seconds, steps, means = (
            np.array([row[name] for row in run.rows], dtype=np.float64)
            for name in ("seconds", "steps", "reward")
        )
        ends = np.concatenate([[0.0], steps])
        earned = np.concatenate([[0.0], np.cumsum(means * np.diff(ends))])
        before = np.interp(steps - WINDOW, ends, earned)
        full = steps >= WINDOW
        return cls(seconds[full], steps[full], ((earned[1:] - before) / WINDOW)[full])

    def walks_from(self, reward: float) -> tuple[float, float]:
        """When the curve rises above a reward and stays there until its end.

        Returns:
            Seconds and control steps at the end of the first iteration from which no point is at or
            below the reward; infinite if the last one is.
        """
        below = np.flatnonzero(self.rewards <= reward)
        first = below[-1] + 1 if len(below) else 0
        if first >= len(self.rewards):
            return math.inf, math.inf
        return float(self.seconds[first]), float(self.steps[first])

    def reward_after(self, seconds: float) -> float:
        """The last point until a time (m); not a number if there is none."""
        until = np.flatnonzero(self.seconds <= seconds)
        return float(self.rewards[until[-1]]) if len(until) else math.nan


def median_or_cap(times: Sequence[float], cap: float) -> float:
    """The median of times (s), of which those that were never reached count with the cap."""
    return float(np.median([min(time, cap) for time in times]))
