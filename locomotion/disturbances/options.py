"""The list of disturbances, as it stands in a configuration; nothing here imports torch.

Each has a value, or a range ``[low, high]`` from which every robot, link or hinge draws its own.
"""

from __future__ import annotations

import dataclasses
import math
import numbers
from typing import Any

from locomotion.options import Checked, key

#: Longest latency (s) of targets or sensors, and so the most that a robot has to remember.
MAX_LATENCY = 10.0


def _spread(
    meaning: str,
    nominal: float | None,
    *,
    above: float | None = None,
    least: float | None = None,
    most: float,
) -> Any:
    """Declares a disturbance: its meaning with the unit, its value without it, and its limits."""
    return key(meaning, default=nominal, above=above, least=least, most=most)


@dataclasses.dataclass
class DisturbancesConfig(Checked):
    """Disturbances of robots: each a value, or a range [low, high] to draw from; nothing by default."""

    PREFIX = "disturbances."

    interval: float = key(
        "how long (s) what was drawn holds; then all robots draw anew",
        default=10.0,
        above=0,
        most=1_000_000_000,
    )
    chance: float = key(
        "of each disturbance to act on a robot, whenever it draws; otherwise nothing changes",
        default=1.0,
        above=0,
        most=1,
    )
    always: list[str] = key("disturbances that act on all robots, whatever the chance", default=[])
    mass: Any = _spread(
        "factor on the mass and inertia of each link, the modules between two hinges",
        1.0,
        above=0,
        most=100,
    )
    strength: Any = _spread("factor on all torque of each servo", 1.0, above=0, most=100)
    stiffness: Any = _spread("factor on the stiffness of each servo", 1.0, above=0, most=100)
    damping: Any = _spread("factor on the damping of each servo", 1.0, least=0, most=100)
    battery: Any = _spread(
        "factor on a robot's voltage: on its servos' largest torque and top speed",
        1.0,
        above=0,
        most=100,
    )
    top_speed: Any = _spread(
        "of a robot's motors without load (rad/s), towards which their largest torque falls; null: no"
        " limit, as in MuJoCo",
        None,
        above=0,
        most=1000,
    )
    friction: Any = _spread("factor on a robot's sliding friction", 1.0, least=0, most=100)
    hinge_friction: Any = _spread("dry friction of each hinge (N·m)", 0.0, least=0, most=100)
    backlash: Any = _spread("play of each hinge's gear (rad)", 0.0, least=0, most=1)
    stuck: Any = _spread("chance of a robot that one of its hinges is stuck", 0.0, least=0, most=1)
    latency: Any = _spread(
        "how late a robot's hinges get their targets (s)", 0.0, least=0, most=MAX_LATENCY
    )
    dropped: Any = _spread(
        "share of control steps whose targets a robot's hinges never get", 0.0, least=0, most=1
    )
    push: Any = _spread(
        "change of a robot's velocity (m/s) by a push, in any direction along the ground",
        0.0,
        least=0,
        most=10,
    )
    push_interval: float = key(
        "time between a robot's pushes (s), on average", default=10.0, above=0, most=1_000_000_000
    )
    sensor_latency: Any = _spread(
        "how old the angles, orientation and speeds are that a robot senses (s)",
        0.0,
        least=0,
        most=MAX_LATENCY,
    )
    hinge_noise: Any = _spread(
        "of a robot's hinge angles: standard deviation of each reading (rad)", 0.0, least=0, most=10
    )
    hinge_bias: Any = _spread(
        "offset of each hinge's angle (rad), to either side", 0.0, least=0, most=10
    )
    orientation_noise: Any = _spread(
        "of a robot's orientation: standard deviation of each reading (rad, about each axis)",
        0.0,
        least=0,
        most=10,
    )
    orientation_bias: Any = _spread(
        "by how much (rad) a robot's orientation is off, about an axis of any direction",
        0.0,
        least=0,
        most=10,
    )
    speed_noise: Any = _spread(
        "of a robot's hinge and angular velocities: standard deviation of each reading (rad/s)",
        0.0,
        least=0,
        most=1000,
    )
    gyro_bias: Any = _spread(
        "offset of a robot's angular velocity (rad/s), about an axis of any direction",
        0.0,
        least=0,
        most=1000,
    )

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            if field.type == "Any":
                self._require_spread(field.name)
        for name in self.always:
            if name not in DEFAULTS:
                self.refuse("always", name, f"names of {', '.join(DEFAULTS)}")
        super().__post_init__()

    def _require_spread(self, name: str) -> None:
        value = getattr(self, name)
        if value is None and DEFAULTS[name] is None:
            return
        ends = list(value) if isinstance(value, (list, tuple)) else [value]
        known = all(isinstance(end, numbers.Real) and not isinstance(end, bool) for end in ends)
        if not known or len(ends) not in (1, 2) or (len(ends) == 1 and ends is value):
            self.refuse(name, value, "a number, or a range [low, high]")
        if len(ends) == 2 and not ends[0] <= ends[1] and not any(map(math.isnan, ends)):
            self.refuse(name, value, "a range with the lower end first")
        # As a configuration spells them, whatever kind of numbers they are.
        plain = [float(end) for end in ends]
        setattr(self, name, plain if isinstance(value, (list, tuple)) else plain[0])

    def ends(self, name: str) -> tuple[float, float]:
        """The lowest and the highest value of a disturbance; both infinite where there is no limit."""
        value = getattr(self, name)
        if value is None:
            return math.inf, math.inf
        return (value[0], value[1]) if isinstance(value, list) else (value, value)

    def active(self, name: str) -> bool:
        """Whether a disturbance changes anything."""
        nominal = DEFAULTS[name]
        nominal = math.inf if nominal is None else nominal
        return self.ends(name) != (nominal, nominal)


#: The value of each disturbance that changes nothing.
DEFAULTS: dict[str, float | None] = {
    field.name: field.default
    for field in dataclasses.fields(DisturbancesConfig)
    if field.type == "Any"
}
#: No disturbances.
NONE = DisturbancesConfig()
