"""The compiled model: all that physics sees of composer."""

from __future__ import annotations

import mujoco
from dm_control import composer


def compile_model(task: composer.Task, sensors: bool = True) -> mujoco.MjModel:
    """Compiles a task's model without what stepping does not need.

    Args:
        task: the task.
        sensors: whether to keep sensors, each of which is computed in every physics step.
    """
    spec = mujoco.MjSpec.from_string(task.root_entity.mjcf_model.to_xml_string())
    # Attachment sites have done their work, and each would be placed anew in every physics step.
    for site in list(spec.sites):
        spec.delete(site)
    if not sensors:
        for sensor in list(spec.sensors):
            spec.delete(sensor)
    return spec.compile()
