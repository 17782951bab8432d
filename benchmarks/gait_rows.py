"""The table of the benchmark of the time to a gait."""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections.abc import Iterator
from typing import Any

from benchmarks.gait_measures import WINDOW, Curve, median_or_cap
from benchmarks.gait_runs import Run
from benchmarks.gait_sides import is_ours, on_ours
from benchmarks.rows import Row

#: Mean rewards of a control step (m) from which a robot walks: the report's final one, and a good gait.
REWARDS = (0.087, 0.2)

#: How many times as fast as others with their own environment, and as others on ours, ours is to be.
TARGETS = {"own": 3.0, "ours": 1.0}


@dataclasses.dataclass
class Measured:
    """All that was measured.

    Attributes:
        seconds: what a side had.
        runs: of all sides.
        apart: of each robot, how far our environment and the others' come apart.
        bare: of each robot, how long bare MuJoCo took for 100,000 control steps (s), a value a turn.
    """

    seconds: float
    runs: list[Run] = dataclasses.field(default_factory=list)
    apart: dict[str, float] = dataclasses.field(default_factory=dict)
    bare: dict[str, list[float]] = dataclasses.field(default_factory=dict)

    def of(self, robot: str) -> dict[str, list[Run]]:
        """The runs of a robot by side."""
        found: dict[str, list[Run]] = {}
        for run in self.runs:
            if run.robot == robot:
                found.setdefault(run.side, []).append(run)
        return found

    def describe(self, run: Run) -> str:
        """A run in a line."""
        if run.missing:
            return f"{run.robot}, seed {run.seed}, {run.side}: {_needs(run.missing)}"
        if not run.rows:
            return f"{run.robot}, seed {run.seed}, {run.side}: no iteration ended in time"
        curve = Curve.of(run)
        times = ", ".join(
            f"{reward} m after {curve.walks_from(reward)[0]:.1f} s" for reward in REWARDS
        )
        last, steps = curve.reward_after(self.seconds), run.rows[-1]["steps"]
        if math.isnan(last):
            return f"{run.robot}, seed {run.seed}, {run.side}: only {steps:,.0f} control steps"
        return (
            f"{run.robot}, seed {run.seed}, {run.side}: {times}; {last:.3f} m in the end,"
            f" {steps:,.0f} control steps"
        )

    def record(self) -> dict[str, Any]:
        """All of it as JSON has it."""
        return {
            "seconds_of_a_side": self.seconds,
            "window": WINDOW,
            "bare_seconds": self.bare,
            "runs": [dataclasses.asdict(run) for run in self.runs],
        }


def rows(found: Measured) -> list[Row]:
    """The table, robot by robot."""
    return [row for robot in found.bare for row in _rows_of(found, robot)]


def _rows_of(found: Measured, robot: str) -> Iterator[Row]:
    bare = found.bare[robot]
    name = f"observations and rewards, ours - others', largest difference, {robot}"
    yield Row(name, [found.apart[robot]], 1e-6, True, "{:.0e}")
    yield Row(f"s, bare MuJoCo, 100,000 control steps, {robot}", bare, form="{:.1f}")
    sides = found.of(robot)
    for reward in REWARDS:
        for side, runs in sides.items():
            yield _time_row(f"s to {reward} m, {side}, {robot}", runs, reward, bare)
    for share in (0.5, 1.0):
        at = share * found.seconds
        for side, runs in sides.items():
            values = [Curve.of(run).reward_after(at) for run in runs if not run.missing]
            known = [value for value in values if not math.isnan(value)]
            yield Row(f"m a control step after {at:.0f} s, {side}, {robot}", known)
    yield from _aims(found, robot, sides)


def _time_row(name: str, runs: list[Run], reward: float, bare: list[float]) -> Row:
    missing = next((run.missing for run in runs if run.missing), "")
    if missing:
        return Row(name, [], context=_needs(missing))
    reached = [Curve.of(run).walks_from(reward) for run in runs]
    times, steps = ([one[part] for one in reached] for part in (0, 1))
    row = Row(name, times, form="{:.1f}")
    if math.isfinite(row.median):
        units = row.median / statistics.median(bare)
        row.context = f"{statistics.median(steps):,.0f} control steps; {units:.2f} x bare MuJoCo"
    else:
        got_there = sum(map(math.isfinite, times))
        row.context = f"{got_there} of {len(times)} got there"
    return row


def _aims(found: Measured, robot: str, sides: dict[str, list[Run]]) -> Iterator[Row]:
    """The speed of the best of ours relative to the best of the others, turn by turn."""
    times = {
        side: [Curve.of(run).walks_from(REWARDS[0])[0] for run in runs]
        for side, runs in sides.items()
        if not any(run.missing for run in runs)
    }

    def best(names: list[str]) -> str | None:
        return min(names, key=lambda side: median_or_cap(times[side], found.seconds), default=None)

    ours = best([side for side in times if is_ours(side)])
    others = {
        "own": best([side for side in times if not is_ours(side) and not on_ours(side)]),
        "ours": best([side for side in times if on_ours(side)]),
    }
    for environment, other in others.items():
        name = f"time to {REWARDS[0]} m, best other on {environment} environment / best of ours"
        row = Row(f"{name}, {robot}", [], TARGETS[environment], form="{:.2f}")
        if ours is None or other is None:
            row.context = "needs a side of each"
        elif not all(map(math.isfinite, times[ours])):
            row.context = f"{ours} did not always get there"
        else:
            # Of an interrupted measurement the last turn may be one side's alone.
            pairs = zip(times[other], times[ours], strict=False)
            row.values = [min(theirs, found.seconds) / mine for theirs, mine in pairs]
            capped = sum(map(math.isinf, times[other]))
            least = f"; at least, as {capped} of {len(times[other])} never got there"
            row.context = f"{other} / {ours}{least * (capped > 0)}"
        yield row


def _needs(package: str) -> str:
    return f"needs {package}: pip install '.[benchmarks]'"
