"""The reality check: how much of a gait is left under what a real robot would bring."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from locomotion.config import Config
from locomotion.evaluation.measures import Interval, measure
from locomotion.evaluation.walking import Disturbances, make_walker, walk


@dataclasses.dataclass(frozen=True)
class Change:
    """One thing that is different.

    Attributes:
        what: in words.
        key: a key of ``physics``, or of :class:`~locomotion.evaluation.Disturbances`.
        of: its value under the change, from the nominal one.
    """

    what: str
    key: str
    of: Callable[[Any], Any]


def _times(factor: float) -> Callable[[float], float]:
    return lambda value: float(f"{factor * value:.12g}")  # 0.1 * 0.01 is 0.001, not a digit more


CHANGES = (
    Change("a tenth of the timestep", "physics.timestep", _times(0.1)),
    Change("limbs that collide", "physics.self_collision", lambda _: True),
    Change("half the friction", "physics.friction", _times(0.5)),
    Change("friction and a half", "physics.friction", _times(1.5)),
    Change("servos 20% weaker", "physics.strength_scale", _times(0.8)),
    Change("servos 20% stronger", "physics.strength_scale", _times(1.2)),
    Change("modules 20% lighter", "physics.mass_scale", _times(0.8)),
    Change("modules 20% heavier", "physics.mass_scale", _times(1.2)),
    Change("targets a quarter second late", "physics.latency", lambda seconds: seconds + 0.25),
    Change("noisy hinge sensors", "noise", lambda deviation: deviation + 0.05),
    Change("pushes", "push", lambda speed: speed + 0.5),
)


@dataclasses.dataclass(frozen=True)
class Share:
    """The speed of robots under a change, as a share of their speed without it.

    Attributes:
        what: the change in words.
        override: the change as an override, such as ``physics.friction=0.5``.
        speed: in m/s.
        share: of the nominal speed, with its 95% confidence interval.
        diverged: share of robots whose simulation diverged; they count as standing still.
    """

    what: str
    override: str
    speed: float
    share: Interval
    diverged: float


def shares(
    run: Path,
    config: Config,
    disturbances: Disturbances,
    seconds: float,
    nominal: torch.Tensor,
    progress: Callable[[], object] = lambda: None,
) -> list[Share]:
    """Walks under each change of :func:`planned`, one at a time, with the policy's mean action.

    The interval is that of a ratio of two means, by the delta method: the relative variances of both
    add up.

    Args:
        run: folder of the run whose policy walks.
        config: the nominal task.
        disturbances: the nominal ones.
        seconds: how long each walk takes.
        nominal: speed of each robot without a change (m/s), shape ``(num_envs,)``; nan if it diverged.
        progress: called after each control step.
    """
    nominal = nominal.nan_to_num(0.0)
    found = []
    for change, changed, disturbed, override in planned(config, disturbances):
        walker = make_walker(run, changed, disturbed)
        values = measure(walk(walker, seconds, progress=progress))
        walker.env.close()
        speeds, diverged = values["speed"].nan_to_num(0.0), values["diverged"].mean().item()
        share = _ratio(speeds, nominal)
        found.append(Share(change.what, override, speeds.mean().item(), share, diverged))
    return found


def planned(
    config: Config, disturbances: Disturbances
) -> list[tuple[Change, Config, Disturbances, str]]:
    """The :data:`CHANGES` that change a task: what it is under each, and the change as an override.

    Raises:
        ConfigError: if a change would put a key out of its range.
    """
    plan = []
    for change in CHANGES:
        group, _, name = change.key.rpartition(".")
        part = getattr(config, group) if group else disturbances
        nominal = getattr(part, name)
        value = change.of(nominal)
        if value == nominal:
            continue
        shown = str(value).lower() if isinstance(value, bool) else f"{value:g}"
        part = dataclasses.replace(part, **{name: value})
        override = f"{change.key}={shown}"
        if group:
            plan.append(
                (change, dataclasses.replace(config, **{group: part}), disturbances, override)
            )
        else:
            plan.append((change, config, part, override))
    return plan


def _ratio(values: torch.Tensor, nominal: torch.Tensor) -> Interval:
    def relative_variance(of: torch.Tensor) -> float:
        return (of.var() / len(of) / of.mean() ** 2).item() if len(of) > 1 else math.nan

    if not nominal.mean():
        return Interval(math.nan, math.nan, math.nan)  # a share of nothing
    ratio = (values.mean() / nominal.mean()).item()
    variance = relative_variance(nominal) + (relative_variance(values) if ratio else 0.0)
    half = 1.96 * abs(ratio) * math.sqrt(variance)
    return Interval(ratio, ratio - half, ratio + half)
