"""The compiled model: all that physics sees of composer."""

from __future__ import annotations

import math

import mujoco
from dm_control import composer

from locomotion.tasks.options import delay_for

#: Prefix of the names of sensors that remember, after which comes what they sense.
SENSED = "sensed"


def compile_model(
    task: composer.Task, sensors: bool = True, sensor_latency: float = 0.0
) -> mujoco.MjModel:
    """Compiles a task's model without what stepping does not need.

    Args:
        task: the task.
        sensors: whether to keep sensors, each of which is computed in every physics step.
        sensor_latency: with one, the model gets sensors of hinges and core that are as late (s).
    """
    spec = mujoco.MjSpec.from_string(task.root_entity.mjcf_model.to_xml_string())
    # Attachment sites have done their work, and each would be placed anew in every physics step.
    for site in list(spec.sites):
        spec.delete(site)
    if not sensors:
        for sensor in list(spec.sensors):
            spec.delete(sensor)
    if sensor_latency:
        _add_late_sensors(spec, sensor_latency)
    return spec.compile()


def _add_late_sensors(spec: mujoco.MjSpec, latency: float) -> None:
    """Adds sensors of hinges' angles and speeds, and of the core's orientation and angular velocity."""
    timestep = spec.option.timestep
    late = {
        "nsample": math.ceil(latency / timestep - 1e-9) + 1,
        "delay": delay_for(latency, timestep),
        "interp": 0,  # the value of that moment's physics step
    }
    joint, body, kinds = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_XBODY, mujoco.mjtSensor
    core, *hinges = spec.joints
    sensed = [
        *(("angle", kinds.mjSENS_JOINTPOS, joint, hinge.name) for hinge in hinges),
        *(("speed", kinds.mjSENS_JOINTVEL, joint, hinge.name) for hinge in hinges),
        ("orientation", kinds.mjSENS_FRAMEQUAT, body, core.parent.name),
        ("turning", kinds.mjSENS_FRAMEANGVEL, body, core.parent.name),
    ]
    for what, kind, objtype, name in sensed:
        spec.add_sensor(
            name=f"{SENSED}:{what}:{name}",
            type=kind,
            objtype=objtype,
            objname=name,
            **late,
        )
