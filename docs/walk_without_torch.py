"""Walks an exported gait with NumPy, MuJoCo and onnxruntime alone.

``python -m locomotion.export robot=gecko`` writes the two files; then, where no torch is needed,
``pip install mujoco onnxruntime`` and ``python walk_without_torch.py gecko.onnx gecko.xml``.
"""

import sys

import mujoco
import numpy as np
import onnxruntime

session = onnxruntime.InferenceSession(sys.argv[1])
model = mujoco.MjModel.from_xml_path(sys.argv[2])
data = mujoco.MjData(model)

inputs = {value.name: np.zeros(value.shape, np.float32) for value in session.get_inputs()}
period = 1 / float(session.get_modelmeta().custom_metadata_map["control_frequency"])
substeps = round(period / model.opt.timestep)

seconds = 20
for _ in range(round(seconds / period)):
    inputs["hinge_position"] = data.qpos[7:].astype(np.float32)
    if "core_orientation" in inputs:
        inputs["core_orientation"] = data.qpos[3:7].astype(np.float32)
    data.ctrl[:], inputs["history"] = session.run(None, inputs)
    mujoco.mj_step(model, data, substeps)

distance = np.linalg.norm(data.qpos[:2])
print(f"{distance:.2f} m in {seconds} s")
