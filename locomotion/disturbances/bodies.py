"""Bodies that differ: what was drawn, written into the parameters that each robot has of the model."""

from __future__ import annotations

import math

import torch

from locomotion.disturbances.draws import Draws
from locomotion.physics import Physics

_SERVO = ("strength", "stiffness", "damping", "battery", "top_speed")
#: Dry friction (N·m) that holds a hinge that is stuck, five times the torque of its servo.
_STUCK = 5.0
#: Columns of MuJoCo's parameters of a position servo: stiffness, and minus stiffness and damping.
_GAIN, _BIAS, _BIAS_SPEED = 0, 1, 2


class Bodies:
    """Gives each robot the masses, servos, friction and latencies that were drawn for it.

    A motor's largest torque falls with its speed, from ``limit`` at rest to 0 at its top speed without
    load. Driven by a stiffness and a damping, its torque is ``clip(stiffness * error - damping * speed,
    -limit - slope * speed, limit - slope * speed)`` with ``slope = limit / top_speed``. That is the same as
    a servo of less damping, ``damping - slope``, whose torque stays within ``limit``, on a hinge with a
    damping of ``slope``, which is how MuJoCo gets it.

    Args:
        draws: what is drawn.
        physics: whose robots they are.
    """

    def __init__(self, draws: Draws, physics: Physics) -> None:
        self._draws = draws
        self._physics = physics
        self._servo = any(name in draws for name in _SERVO)
        self._nominal = {
            name: torch.as_tensor(getattr(physics.model, name), device=physics.device)
            for name in (
                *("body_mass", "body_inertia", "actuator_gainprm", "actuator_biasprm"),
                *("actuator_forcerange", "dof_damping", "pair_friction", "geom_friction"),
            )
        }

    def write(self) -> None:
        """Writes what was drawn."""
        draws = self._draws
        if "mass" in draws:
            self._write("body_mass", self._nominal["body_mass"][1:] * draws["mass"], 1)
            inertia = self._nominal["body_inertia"][1:] * draws["mass"][..., None]
            self._write("body_inertia", inertia, 1)
            self._physics.set_const()
        if self._servo:
            self._write_servos()
        if "top_speed" in draws:
            self._write("dof_damping", self._nominal["dof_damping"][6:] + self._slope(), 6)
        if "hinge_friction" in draws or "stuck" in draws:
            friction = draws.get("hinge_friction") + _STUCK * draws.get("stuck")
            self._write("dof_frictionloss", friction, 6)
        if "friction" in draws:
            for name, columns in (("pair_friction", 2), ("geom_friction", 1)):
                nominal = self._nominal[name]
                if len(nominal):
                    sliding = nominal[:, :columns] * draws["friction"][..., None]
                    self._physics.expand(name)[..., :columns] = sliding
        if "latency" in draws:
            self._physics.set_latency(draws["latency"][:, 0])
        if "sensor_latency" in draws:
            # What a step leaves is a physics step old as it is.
            latency = draws["sensor_latency"] - self._physics.model.opt.timestep
            self._physics.set_sensor_latency(latency[:, 0].clamp(min=0.0))

    def torque(self, force: torch.Tensor) -> torch.Tensor:
        """The torques of motors (N·m), of MuJoCo's ``actuator_force``."""
        return force - self._slope() * self._physics.qvel[:, 6:].to(force)

    def _write(self, name: str, values: torch.Tensor, first: int) -> None:
        self._physics.expand(name)[:, first:] = values

    def _write_servos(self) -> None:
        draws, nominal = self._draws, self._nominal
        strength = draws.get("strength")
        stiffness = nominal["actuator_gainprm"][:, _GAIN] * strength * draws.get("stiffness")
        damping = -nominal["actuator_biasprm"][:, _BIAS_SPEED] * strength * draws.get("damping")
        limit = nominal["actuator_forcerange"][:, 1] * strength * draws.get("battery")
        self._physics.expand("actuator_gainprm")[..., _GAIN] = stiffness
        bias = self._physics.expand("actuator_biasprm")
        bias[..., _BIAS] = -stiffness
        bias[..., _BIAS_SPEED] = self._slope() - damping
        both = torch.stack(torch.broadcast_tensors(-limit, limit), -1)
        self._physics.expand("actuator_forcerange").copy_(both)

    def _slope(self) -> torch.Tensor | float:
        """By how much the largest torque falls with speed (N·m·s/rad); voltage cancels out."""
        top_speed = self._draws.get("top_speed")
        if isinstance(top_speed, float) and math.isinf(top_speed):
            return 0.0
        torque = self._nominal["actuator_forcerange"][:, 1]
        return torque * self._draws.get("strength") / top_speed
