"""Contact sensors, which tell what modules touch the ground."""

from __future__ import annotations

import weakref

import mujoco
import torch
from dm_control import composer

from locomotion.robots.modular_robot import ModularRobot

#: Prefix of the sensors' names.
_PREFIX = "contact:"


def add_touch_sensors(robot: ModularRobot, arena: composer.Arena) -> None:
    """Adds a sensor for each geom of a robot that can touch the ground of its arena."""
    for path, module in robot.modules.items():
        for geom in module.mjcf_model.find_all("geom", exclude_attachments=True):
            if geom in robot.covered_geoms:
                continue
            for number, ground in enumerate(arena.ground_geoms):
                arena.mjcf_model.sensor.add(
                    "contact",
                    name=f"{_PREFIX}{path.replace('/', ':')}:{geom.name}:{number}",
                    geom1=ground,
                    geom2=geom,
                    data="found",
                    num=1,
                )


class TouchMap:
    """The map from the touch sensors of a compiled model to the modules of a robot.

    Args:
        robot: the robot.
    """

    def __init__(self, robot: ModularRobot) -> None:
        self._paths = {path.replace("/", ":"): i for i, path in enumerate(robot.modules)}
        # dm-control compiles a model anew for every episode.
        self._known: weakref.WeakKeyDictionary[mujoco.MjModel, torch.Tensor] = (
            weakref.WeakKeyDictionary()
        )

    def __call__(self, model: mujoco.MjModel, like: torch.Tensor) -> torch.Tensor:
        """Returns the map.

        Args:
            model: the model.
            like: a tensor with the dtype and the device that are wanted.

        Returns:
            Ones and zeros of shape ``(nsensordata, modules)``, in the order of ``robot.modules``.
        """
        known = self._known.get(model)
        if known is None or (known.dtype, known.device) != (like.dtype, like.device):
            known = self._known[model] = self._make(model).to(like)
        return known

    def _make(self, model: mujoco.MjModel) -> torch.Tensor:
        table = torch.zeros(model.nsensordata, len(self._paths), dtype=torch.float64, device="cpu")
        for sensor in range(model.nsensor):
            name = model.sensor(sensor).name
            if name.startswith(_PREFIX):
                module = name[len(_PREFIX) :].rsplit(":", 2)[0]
                table[model.sensor_adr[sensor], self._paths[module]] = 1.0
        return table
