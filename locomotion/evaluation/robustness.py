"""The reality check: how much of a gait is left under what a real robot would bring."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import torch

from locomotion.config import Config
from locomotion.evaluation.measures import Interval, measure
from locomotion.evaluation.walking import make_runner, walk
from locomotion.robots.geometry import HINGE_SPEED


@dataclasses.dataclass(frozen=True)
class Perturbation:
    """One thing that is different.

    Attributes:
        what: in words.
        values: for each key, of ``physics`` or ``disturbances``, its value under the change, from the
            nominal one.
        broken: whether the robot is no longer whole, so that less is to be expected of it.
        arena: what robots walk on in place of flat ground.
    """

    what: str
    values: Mapping[str, Callable[[Any], Any]] = dataclasses.field(default_factory=dict)
    broken: bool = False
    arena: Mapping[str, Any] = dataclasses.field(default_factory=dict)


def _times(factor: float) -> Callable[[Any], Any]:
    return _on_each(lambda value: factor * value)


def _plus(more: float) -> Callable[[Any], Any]:
    return _on_each(lambda value: value + more)


def _on_each(change: Callable[[float], float]) -> Callable[[Any], Any]:
    """A change of a number, or of both ends of a range; 0.1 * 0.01 is 0.001, not a digit more."""

    def changed(value: Any) -> Any:
        if isinstance(value, list):
            return [changed(end) for end in value]
        return float(f"{change(value):.12g}")

    return changed


def _disturbed(what: str, change: Callable[[Any], Any], name: str, **others: Any) -> Perturbation:
    named = {f"disturbances.{key}": of for key, of in {name: change, **others}.items()}
    return Perturbation(what, named, broken=name == "stuck")


def _to(value: float) -> Callable[[Any], Any]:
    return lambda nominal: value if nominal is None else nominal


PERTURBATIONS = (
    Perturbation("a tenth of the timestep", {"physics.timestep": _times(0.1)}),
    Perturbation("limbs that collide", {"physics.self_collision": lambda _: True}),
    _disturbed("half the friction", _times(0.5), "friction"),
    _disturbed("friction and a half", _times(1.5), "friction"),
    _disturbed("servos 20% weaker", _times(0.8), "strength"),
    _disturbed("servos 20% stronger", _times(1.2), "strength"),
    _disturbed("servos 20% softer", _times(0.8), "stiffness"),
    _disturbed("servos 20% less damped", _times(0.8), "damping"),
    _disturbed("modules 20% lighter", _times(0.8), "mass"),
    _disturbed("modules 20% heavier", _times(1.2), "mass"),
    _disturbed("dry friction in the hinges", _plus(0.05), "hinge_friction"),
    _disturbed("play in the gears", _plus(0.05), "backlash"),
    _disturbed("motors with a top speed", _to(HINGE_SPEED), "top_speed"),
    _disturbed("a battery at 80%", _times(0.8), "battery", top_speed=_to(HINGE_SPEED)),
    _disturbed("targets a quarter second late", _plus(0.25), "latency"),
    _disturbed("one target in ten lost", _plus(0.1), "dropped"),
    _disturbed("sensors a tenth of a second late", _plus(0.1), "sensor_latency"),
    _disturbed("noisy hinge sensors", _plus(0.05), "hinge_noise"),
    _disturbed("hinge sensors that are off", _plus(0.05), "hinge_bias"),
    _disturbed("a noisy IMU", _plus(0.05), "orientation_noise", speed_noise=_plus(0.2)),
    _disturbed("an IMU that is off", _plus(0.1), "orientation_bias", gyro_bias=_plus(0.1)),
    _disturbed("pushes", _plus(0.5), "push"),
    _disturbed("one hinge stuck", lambda _: 1.0, "stuck"),
    Perturbation("bumps of 4 cm", arena={"name": "rough", "height": 0.04}),
    Perturbation("slopes of a fifth", arena={"name": "slopes", "height": 0.4}),
    Perturbation("stairs of 3 cm", arena={"name": "steps", "height": 0.03}),
    Perturbation("stepping stones", arena={"name": "stones", "height": 0.05}),
)


@dataclasses.dataclass(frozen=True)
class Robustness:
    """The speed of robots under a change, as a share of their speed without it.

    Attributes:
        what: the change in words.
        override: the change as overrides, such as ``disturbances.friction=0.5``.
        speed: in m/s.
        share: of the nominal speed, with its 95% confidence interval.
        diverged: share of robots whose simulation diverged; they count as standing still.
    """

    what: str
    override: str
    speed: float
    share: Interval
    diverged: float


def check_robustness(
    run: Path,
    config: Config,
    seconds: float,
    nominal: torch.Tensor,
    progress: Callable[[], object] = lambda: None,
) -> Iterator[Robustness]:
    """Walks under each change of :func:`perturbed`, one at a time, with the policy's mean action.

    The interval is that of a ratio of two means, by the delta method: the relative variances of both
    add up.

    Args:
        run: folder of the run whose policy walks.
        config: the nominal task.
        seconds: how long each walk takes.
        nominal: speed of each robot without a change (m/s), shape ``(num_envs,)``; nan if it diverged.
        progress: called after each control step.
    """
    nominal = nominal.nan_to_num(0.0)
    for change, changed, override in perturbed(config):
        runner = make_runner(run, changed)
        values = measure(walk(runner, seconds, progress=progress))
        runner.env.close()
        speeds, diverged = values["speed"].nan_to_num(0.0), values["diverged"].mean().item()
        share = _ratio(speeds, nominal)
        yield Robustness(change.what, override, speeds.mean().item(), share, diverged)


def perturbed(config: Config) -> list[tuple[Perturbation, Config, str]]:
    """The :data:`PERTURBATIONS` that change a task: what it is under each, and the change as overrides.

    Raises:
        ConfigError: if a change would put a key out of its range.
    """
    plan = []
    for change in PERTURBATIONS:
        changed, overrides = config, []
        if change.arena and config.arena["name"] == "ground":
            changed = dataclasses.replace(config, arena=dict(change.arena))
            name, *options = change.arena.items()
            overrides = [f"arena={name[1]}", *(f"arena.{key}={of:g}" for key, of in options)]
        for key, of in change.values.items():
            group, _, name = key.partition(".")
            part = getattr(changed, group)
            value = of(getattr(part, name))
            if value != getattr(part, name):
                part = dataclasses.replace(part, **{name: value})
                changed = dataclasses.replace(changed, **{group: part})
                overrides.append(f"{key}={_shown(value)}")
        if overrides:
            plan.append((change, changed, " ".join(overrides)))
    return plan


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return f"[{','.join(map(_shown, value))}]"
    return str(value).lower() if isinstance(value, bool) else f"{value:g}"


def _ratio(values: torch.Tensor, nominal: torch.Tensor) -> Interval:
    def relative_variance(of: torch.Tensor) -> float:
        return (of.var() / len(of) / of.mean() ** 2).item() if len(of) > 1 else math.nan

    if not nominal.mean():
        return Interval(math.nan, math.nan, math.nan)  # a share of nothing
    ratio = (values.mean() / nominal.mean()).item()
    variance = relative_variance(nominal) + (relative_variance(values) if ratio else 0.0)
    half = 1.96 * abs(ratio) * math.sqrt(variance)
    return Interval(ratio, ratio - half, ratio + half)
