"""The options of a task: ``env`` and ``task`` in a configuration."""

from __future__ import annotations

import dataclasses
import enum
from typing import TYPE_CHECKING, Any, TypeVar

from locomotion.options.checked import Checked, ConfigError, key
from locomotion.robots.geometry import HINGE_RANGE

if TYPE_CHECKING:
    import torch

    Seconds = TypeVar("Seconds", float, torch.Tensor)

#: Length of a physics step (s).
TIMESTEP = 0.01


class Integrator(enum.Enum):
    """MuJoCo's integrators that can be chosen."""

    implicitfast = "implicitfast"
    implicit = "implicit"


class Start(enum.Enum):
    """Poses in which episodes start."""

    upright = "upright"
    any = "any"


@dataclasses.dataclass
class EnvConfig(Checked):
    """Episodes and actions, the report's by default."""

    PREFIX = "env."

    num_envs: int = key("robots that are stepped together", default=64, least=1, most=1_000_000)
    control_frequency: float = key("actions a second (Hz)", default=4.0, above=0, most=1000)
    settle_time: float = key(
        "at the start, how long (s) a robot settles under random targets",
        default=0.5,
        least=0,
        most=3600,
    )
    start: Start = key(
        "pose of the core at the start: upright and facing along x, or any: any heading, upright or overturned",
        default=Start.upright,
    )
    overturned: float = key(
        "with env.start=any, how many of the starts are overturned, 0 to 1",
        default=0.5,
        least=0,
        most=1,
    )
    compass: bool = key(
        "whether orientations tell the heading in the world; false: the heading from that at the start, as an"
        " IMU without a magnetometer does",
        default=True,
    )
    time_limit: float | None = key(
        "length of an episode (s), then a reset; null: robots walk on for ever",
        default=None,
        above=0,
        most=1_000_000_000,
    )
    stagger: bool = key(
        "with env.time_limit, whether robots begin a training at random times of their episodes, so that they"
        " are not all reset at once",
        default=False,
    )
    target_limit: float = key(
        "how far (rad) a hinge can be sent to either side; what is further is clipped",
        default=1.0,
        above=0,
        most=HINGE_RANGE,
    )
    clock_frequency: float = key("of the reading phase_clock (Hz)", default=1.0, above=0, most=1000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.step_limit == 0:
            period = 1 / self.control_frequency
            self.refuse("time_limit", self.time_limit, f"at least {period:g}, one action")

    @property
    def step_limit(self) -> int | None:
        """Control steps in an episode; ``None`` if it does not end."""
        return None if self.time_limit is None else round(self.time_limit * self.control_frequency)


@dataclasses.dataclass
class TaskConfig(Checked):
    """Options of the task."""

    PREFIX = "task."

    rewards: dict[str, Any] = key(
        "by name, the rewards that are added up: each with a weight and options of its own"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.rewards:
            raise ConfigError("task.rewards is empty, so nothing could be learned")


def substeps(control_frequency: float, timestep: float) -> int:
    """Physics steps in a control step.

    Raises:
        ConfigError: if the control period is not a multiple of the timestep.
    """
    period = 1 / control_frequency
    exact = period / timestep
    asked = f"physics.timestep={timestep} must divide the control period of {period:g} s"
    asked += f" (env.control_frequency={control_frequency})"
    if round(exact) < 1 or abs(exact - round(exact)) > 1e-6 * exact:
        fits = period / max(1, round(exact))
        raise ConfigError(f"{asked}; {fits:.9g} does")
    if round(exact) > 1_000_000:
        raise ConfigError(
            f"physics.timestep={timestep} must be at least a millionth of the control period of"
            f" {period:g} s (env.control_frequency={control_frequency})"
        )
    return round(exact)


def delay_for(latency: Seconds, timestep: float) -> Seconds:
    """The delay of MuJoCo's actuators by which targets arrive a latency late.

    It is shorter, by at most a thousandth of a timestep, so that a latency of whole timesteps takes as
    many of them however the clock is rounded.

    Args:
        latency: one or more (s), at least 0.
        timestep: length of a physics step (s).
    """
    return latency - 1e-3 * timestep * latency / (latency + timestep)
