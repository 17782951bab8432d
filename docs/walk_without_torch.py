"""Walks an exported gait with NumPy, MuJoCo and onnxruntime alone.

``python -m locomotion.export robot=gecko`` writes the two files; then, where no torch is needed,
``pip install mujoco onnxruntime`` and ``python walk_without_torch.py gecko.onnx gecko.xml``.
"""

import json
import sys

import mujoco
import numpy as np
import onnxruntime

policy = onnxruntime.InferenceSession(sys.argv[1])
model = mujoco.MjModel.from_xml_path(sys.argv[2])
data = mujoco.MjData(model)

metadata = policy.get_modelmeta().custom_metadata_map
period = 1 / float(metadata["control_frequency"])
clock_frequency = float(metadata["clock_frequency"])
sizes = {value.name: value.shape for value in policy.get_inputs()}
memory = {name: np.zeros(sizes[name], np.float32) for name in json.loads(metadata["memory"])}


def read():
    """What a robot's sensors would say; other readings of a policy are added here."""
    to_core, velocity, angle = np.zeros(4), np.zeros(3), 2 * np.pi * clock_frequency * data.time
    mujoco.mju_negQuat(to_core, data.qpos[3:7])
    mujoco.mju_rotVecQuat(velocity, data.qvel[:3], to_core)
    return {
        "hinge_position": data.qpos[7:],
        "hinge_velocity": data.qvel[6:],
        "hinge_target": data.ctrl,
        "core_orientation": data.qpos[3:7],
        "core_angular_velocity": data.qvel[3:6],
        "core_linear_velocity": velocity,
        "core_height": data.qpos[2:3],
        "phase_clock": np.array([np.cos(angle), np.sin(angle)]),
    }


seconds = 20
for _ in range(round(seconds / period)):
    readings = read()
    inputs = {name: readings[name].astype(np.float32) for name in sizes if name not in memory}
    data.ctrl[:], *following = policy.run(None, inputs | memory)
    memory = dict(zip(memory, following))
    mujoco.mj_step(model, data, round(period / model.opt.timestep))

distance = np.linalg.norm(data.qpos[:2])
print(f"{distance:.2f} m in {seconds} s")
