"""Senses that are late, off and noisy: the state of robots as their sensors tell it."""

from __future__ import annotations

import mujoco
import torch

from locomotion.disturbances.draws import Draws
from locomotion.physics import Physics
from locomotion.tasks.model import SENSED
from locomotion.tasks.state import into_frame

_ANGLES = ("hinge_noise", "hinge_bias")
_TURNS = ("orientation_noise", "orientation_bias")
_SPEEDS = ("speed_noise", "gyro_bias")


class Senses:
    """Tells positions and velocities as sensors do: those of a while ago, with bias and noise.

    The core's place is left as it is.

    Args:
        draws: what is drawn.
        physics: whose robots they are; with ``sensor_latency`` its model has the sensors of
            :func:`~locomotion.tasks.compile_model`, which remember.
    """

    def __init__(self, draws: Draws, physics: Physics) -> None:
        self._draws = draws
        self._physics = physics
        self._columns: dict[str, slice] = {}
        if "sensor_latency" in draws:
            self._columns = _columns(physics.model)
            physics.field("sensordata")

    def __call__(self, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        """Positions and velocities, of the shapes of ``qpos`` and ``qvel``.

        Args:
            generator: draws the noise.
        """
        draws = self._draws
        qpos, qvel = self._physics.qpos, self._physics.qvel
        if "sensor_latency" in draws:
            qpos, qvel = self._late(qpos, qvel)
        else:
            qpos, qvel = qpos.clone(), qvel.clone()
        if any(name in draws for name in _ANGLES):
            qpos[:, 7:] += self._off(*_ANGLES, qpos[:, 7:], generator)
        if any(name in draws for name in _TURNS):
            by = self._off(*_TURNS, qpos[:, :3], generator)
            qpos[:, 3:7] = _turned(qpos[:, 3:7], by)
        if any(name in draws for name in _SPEEDS):
            qvel[:, 3:] += self._noise("speed_noise", qvel[:, 3:], generator)
            qvel[:, 3:6] += draws.get("gyro_bias")
        return qpos, qvel

    def _off(
        self, noise: str, bias: str, like: torch.Tensor, generator: torch.Generator
    ) -> torch.Tensor:
        return self._noise(noise, like, generator) + self._draws.get(bias)

    def _noise(
        self, name: str, like: torch.Tensor, generator: torch.Generator
    ) -> torch.Tensor | float:
        if name not in self._draws:
            return 0.0
        how = {"generator": generator, "dtype": like.dtype, "device": like.device}
        return self._draws[name] * torch.randn(like.shape, **how)

    def _late(self, qpos: torch.Tensor, qvel: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        sensed = self._physics.field("sensordata").to(qpos.dtype)
        parts = {name: sensed[:, columns] for name, columns in self._columns.items()}
        before, speeds = qpos.clone(), qvel.clone()
        before[:, 3:7], before[:, 7:] = parts["orientation"], parts["angle"]
        speeds[:, 3:6] = into_frame(parts["orientation"], parts["turning"])
        speeds[:, 6:] = parts["speed"]
        # A robot that is younger than its senses are late senses its present.
        latency = self._draws["sensor_latency"]
        young = self._physics.field("time")[:, None] < latency + self._physics.model.opt.timestep
        return torch.where(young, qpos, before), torch.where(young, qvel, speeds)


def _columns(model: mujoco.MjModel) -> dict[str, slice]:
    """The places in ``sensordata`` of sensors with a delay, by what they sense."""
    found: dict[str, list[int]] = {}
    for sensor in range(model.nsensor):
        prefix, _, kind = model.sensor(sensor).name.partition(":")
        if prefix == SENSED:
            first = model.sensor_adr[sensor]
            last = first + model.sensor_dim[sensor]
            found.setdefault(kind.partition(":")[0], []).extend(range(first, last))
    return {kind: slice(columns[0], columns[-1] + 1) for kind, columns in found.items()}


def _turned(orientation: torch.Tensor, by: torch.Tensor) -> torch.Tensor:
    """Orientations that are turned, in the core's frame, by rotation vectors (rad)."""
    half = by.norm(dim=1, keepdim=True) / 2
    # sin(x) / x, which is 1 at 0.
    u = torch.sinc(half / torch.pi) * by / 2
    w, v = orientation[:, :1], orientation[:, 1:]
    cos = half.cos()
    scalar = w * cos - (v * u).sum(1, keepdim=True)
    return torch.cat([scalar, w * u + cos * v + v.cross(u, dim=1)], 1)
