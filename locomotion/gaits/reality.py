"""The reality check: how much of a gait is left under what a real robot would bring."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from locomotion.config import Config
from locomotion.gaits.measures import Interval, measure
from locomotion.gaits.walking import Disturbances, make_walker, walk


@dataclasses.dataclass(frozen=True)
class Change:
    """One thing that is different.

    Attributes:
        what: in words.
        key: a key of ``physics``, or of :class:`~locomotion.gaits.Disturbances`.
        factor: what the key is multiplied by, unless it is set to ``value``.
        value: what the key is set to.
    """

    what: str
    key: str
    factor: float | None = None
    value: Any = None


CHANGES = (
    Change("a tenth of the timestep", "physics.timestep", factor=0.1),
    Change("limbs that collide", "physics.self_collision", value=True),
    Change("half the friction", "physics.friction", factor=0.5),
    Change("friction and a half", "physics.friction", factor=1.5),
    Change("servos 20% weaker", "physics.strength_scale", factor=0.8),
    Change("servos 20% stronger", "physics.strength_scale", factor=1.2),
    Change("modules 20% lighter", "physics.mass_scale", factor=0.8),
    Change("modules 20% heavier", "physics.mass_scale", factor=1.2),
    Change("targets a step late", "delay", value=1),
    Change("noisy hinge sensors", "noise", value=0.05),
    Change("pushes", "push", value=0.5),
)


@dataclasses.dataclass(frozen=True)
class Share:
    """How fast robots are under a change, as a share of how fast they are without.

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
    progress: Callable[[], object] = lambda: None,
) -> list[Share]:
    """Walks under each of :data:`CHANGES`, one at a time, with the policy's mean action.

    The interval is that of a ratio of two means, by the delta method: the relative variances of both
    add up.

    Args:
        run: folder of the run whose policy walks.
        config: the nominal task.
        disturbances: the nominal ones.
        seconds: how long each walk takes.
        progress: called after each control step.
    """
    nominal = _speeds(run, config, disturbances, seconds, progress)[0]
    found = []
    for change in CHANGES:
        changed, disturbed, override = _apply(change, config, disturbances)
        speeds, diverged = _speeds(run, changed, disturbed, seconds, progress)
        share = _ratio(speeds, nominal)
        found.append(Share(change.what, override, speeds.mean().item(), share, diverged))
    return found


def _apply(
    change: Change, config: Config, disturbances: Disturbances
) -> tuple[Config, Disturbances, str]:
    group, _, name = change.key.rpartition(".")
    part = getattr(config, group) if group else disturbances
    value = change.value
    if change.factor is not None:
        value = float(f"{change.factor * getattr(part, name):.12g}")
    part = dataclasses.replace(part, **{name: value})
    shown = str(value).lower() if isinstance(value, bool) else f"{value:g}"
    override = f"{change.key}={shown}"
    if group:
        return dataclasses.replace(config, **{group: part}), disturbances, override
    return config, part, override


def _speeds(
    run: Path,
    config: Config,
    disturbances: Disturbances,
    seconds: float,
    progress: Callable[[], object],
) -> tuple[torch.Tensor, float]:
    """The speed of each robot (m/s), and the share of those that diverged."""
    walker = make_walker(run, config, disturbances)
    values = measure(walk(walker, seconds, progress=progress))
    walker.env.close()
    return values["speed"].nan_to_num(0.0), values["diverged"].mean().item()


def _ratio(values: torch.Tensor, nominal: torch.Tensor) -> Interval:
    def relative_variance(of: torch.Tensor) -> float:
        return (of.var() / len(of) / of.mean() ** 2).item() if len(of) > 1 else math.nan

    ratio = (values.mean() / nominal.mean()).item()
    half = 1.96 * abs(ratio) * math.sqrt(relative_variance(values) + relative_variance(nominal))
    return Interval(ratio, ratio - half, ratio + half)
