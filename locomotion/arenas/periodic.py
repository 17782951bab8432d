"""Periodic ground in a compiled model: its period, and the body that carries it along under a robot."""

from __future__ import annotations

import mujoco
import numpy as np

#: Name of the body that carries the ground, and of the number that says its period (m).
TERRAIN = "terrain"


def period_of(model: mujoco.MjModel) -> float | None:
    """The period (m) of a model's ground; ``None`` if it is not periodic."""
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, TERRAIN)
    return None if number < 0 else float(model.numeric_data[model.numeric_adr[number]])


def put_under(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Moves periodic ground under the robot of a ``MjData``; other ground stays where it is."""
    period = period_of(model)
    if period is not None:
        data.mocap_pos[0, :2] = period * np.round(data.qpos[:2] / period)
