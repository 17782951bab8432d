"""Revolve2's standard bodies: files against the data, compiled hinges against plain kinematics."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from locomotion.options import choices
from locomotion.robots import ModularRobot, load_robot

pytestmark = pytest.mark.slow

#: Module, quarter turns and children of each module, as Revolve2 has them.
BODIES = json.loads(Path(__file__).with_name("revolve2_v1.json").read_text(encoding="utf-8"))
MASSES = {"core": 0.250, "brick": 0.030, "hinge": 0.011 + 0.058}
CORE, BRICK = 0.089, 0.06288625
#: From the start of a hinge to its axis, and to where a child is attached (m).
AXIS = 0.04525 / 2 + 0.0119
LENGTH = 0.04525 / 2 + 0.0299 + 0.0583 / 2 + 0.002


def step(x, y, degrees_about_z):
    return RigidTransform.from_components(
        [x, y, 0], Rotation.from_euler("z", degrees_about_z, True)
    )


FACES = {
    "core": {
        "front": step(CORE / 2, 0, 0),
        "left": step(0, CORE / 2, 90),
        "back": step(-CORE / 2, 0, 180),
        "right": step(0, -CORE / 2, 270),
    },
    "brick": {
        "front": step(BRICK, 0, 0),
        "left": step(BRICK / 2, BRICK / 2, 90),
        "right": step(BRICK / 2, -BRICK / 2, 270),
    },
    "hinge": {"attachment": step(LENGTH, 0, 0)},
}


def walk(module, path="core", pose=None):
    """Yields each module with its path and its pose in the core's frame."""
    pose = RigidTransform.identity() if pose is None else pose
    yield module, path, pose
    for face, child in module.get("children", {}).items():
        roll = Rotation.from_euler("x", 90 * child["quarter_turns"], True)
        there = pose * FACES[module["module"]][face] * RigidTransform.from_rotation(roll)
        yield from walk(child, f"{path}/{face}", there)


def plain(module):
    """A body of this project in the data's words."""
    children = {face: plain(child) for face, child in module.children.items()}
    found = {"module": module.kind, "quarter_turns": module.quarter_turns}
    return {**found, "children": children} if children else found


def test_every_standard_body_can_be_chosen():
    assert len(BODIES) == 22
    assert BODIES.keys() <= set(choices("robot"))


@pytest.mark.parametrize("name", BODIES)
def test_a_standard_body_is_that_of_revolve2(name):
    config = load_robot(name)
    robot = ModularRobot(config.body)
    assert config.name == name
    assert plain(robot.body) == BODIES[name]["core"]


@pytest.mark.parametrize("name", BODIES)
def test_hinges_of_a_standard_body_are_where_plain_kinematics_has_them(name):
    robot = ModularRobot(load_robot(name).body)
    model = mujoco.MjModel.from_xml_string(robot.mjcf_model.to_xml_string())
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    modules = [*walk(BODIES[name]["core"])]
    poses = {path: pose for module, path, pose in modules if module["module"] == "hinge"}
    assert len(poses) == model.njnt == BODIES[name]["hinges"]
    for path, pose in poses.items():
        joint = model.joint(f"{path}/hinge").id
        np.testing.assert_allclose(data.xanchor[joint], pose.apply([AXIS, 0, 0]), atol=1e-9)
        np.testing.assert_allclose(data.xaxis[joint], pose.rotation.apply([0, 1, 0]), atol=1e-9)
    mass = sum(MASSES[module["module"]] for module, _, _ in modules)
    assert model.body_mass.sum() == pytest.approx(mass)
