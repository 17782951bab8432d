"""A body's mirrors: against the compiled model, at rest and as it moves."""

import functools
import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from locomotion.robots import ModularRobot, load_robot, mirrors, parse_body
from locomotion.tasks import WalkAway, compile_model

BODIES = json.loads(Path(__file__).with_name("revolve2_v1.json").read_text(encoding="utf-8"))
#: Reflections of the core's frame, and the standard bodies that each of them maps to themselves.
PLANES = {
    "x-z": np.diag([1.0, -1.0, 1.0]),
    "y-z": np.diag([-1.0, 1.0, 1.0]),
    "x=y": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "x=-y": np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}
SYMMETRIC = {
    "ant": ["x-z"],
    "babyb": ["x-z"],
    "gecko": ["x-z"],
    "snake": ["y-z"],
    "spider": ["x-z", "y-z", "x=y", "x=-y"],
}
#: 25 physics steps round off by less than 1e-12, in the air and on the ground.
CLOSE = 1e-9


def planes(body):
    """The names of the planes of a body's mirrors."""
    return [
        name
        for mirror in mirrors(body)
        for name, reflection in PLANES.items()
        if np.array_equal(mirror.reflection, reflection)
    ]


@functools.cache
def compiled(name):
    """A standard body, and its model on flat ground."""
    robot = ModularRobot(load_robot(name).body, name=name)
    return robot.body, compile_model(WalkAway(robot), sensors=False)


@pytest.mark.parametrize("name", BODIES)
def test_mirrors_are_the_planes_that_map_the_compiled_geoms_to_themselves(name):
    body, model = compiled(name)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geoms = model.geom_type == mujoco.mjtGeom.mjGEOM_BOX
    centres = data.geom_xpos[geoms] - data.qpos[:3]
    turns = data.geom_xmat[geoms].reshape(-1, 3, 3)
    lengths = np.abs(np.einsum("gij,gj->gi", turns, model.geom_size[geoms]))
    here = np.concatenate([centres, lengths], 1)
    expected = []
    for plane, reflection in PLANES.items():
        there = np.concatenate([centres @ reflection.T, lengths @ np.abs(reflection)], 1)
        gaps = np.abs(here[:, None] - there[None]).max(-1)
        if gaps.min(0).max() < 1e-6:
            expected.append(plane)
    assert planes(body) == expected == SYMMETRIC.get(name, [])


def image(mirror, qpos, qvel, control):
    """Positions, velocities and targets of a robot's mirror image."""
    hinges = mirror.hinge_matrix
    place = [mirror.reflection @ qpos[:3], mirror.quaternion_matrix @ qpos[3:7], hinges @ qpos[7:]]
    speeds = [mirror.reflection @ qvel[:3], mirror.axial_matrix @ qvel[3:6], hinges @ qvel[6:]]
    return np.concatenate(place), np.concatenate(speeds), hinges @ control


def stepped(model, qpos, qvel, control):
    """Positions and velocities after a control step, and the most contacts on the way."""
    data, contacts = mujoco.MjData(model), 0
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, control
    for _ in range(25):
        mujoco.mj_step(model, data)
        contacts = max(contacts, data.ncon)
    return data.qpos.copy(), data.qvel.copy(), contacts


def flying(model, draw):
    """A robot high above the ground, in any pose, that turns and swings its limbs."""
    quaternion = draw.normal(size=4)
    angles = draw.uniform(-1, 1, model.nu)
    place = [draw.normal(size=2), [5.0], quaternion / np.linalg.norm(quaternion), angles]
    return np.concatenate(place), draw.normal(size=model.nv)


def walking(model, draw):
    """A robot that has been walking for half a second."""
    data = mujoco.MjData(model)
    for _ in range(2):
        data.ctrl[:] = draw.uniform(-1, 1, model.nu)
        mujoco.mj_step(model, data, 25)
    return data.qpos.copy(), data.qvel.copy()


@pytest.mark.parametrize(("begin", "touches"), [(flying, False), (walking, True)])
@pytest.mark.parametrize("name", SYMMETRIC)
def test_a_mirrored_state_and_action_lead_to_the_mirrored_state(name, begin, touches):
    body, model = compiled(name)
    draw = np.random.default_rng(0)
    for _ in range(3):
        qpos, qvel = begin(model, draw)
        control = draw.uniform(-1, 1, model.nu)
        after, speeds, contacts = stepped(model, qpos, qvel, control)
        assert (contacts > 0) == touches
        assert np.abs(after - qpos).max() > 0.1
        for mirror in mirrors(body):
            expected, expected_speeds, _ = image(mirror, after, speeds, control)
            found, found_speeds, _ = stepped(model, *image(mirror, qpos, qvel, control))
            np.testing.assert_allclose(found, expected, rtol=0, atol=CLOSE)
            np.testing.assert_allclose(found_speeds, expected_speeds, rtol=0, atol=CLOSE)


@pytest.mark.parametrize("name", SYMMETRIC)
def test_an_image_of_an_image_is_what_was_mirrored(name):
    body, _ = compiled(name)
    for mirror in mirrors(body):
        assert len(mirror.modules) == len(list(body.walk()))
        for matrix in (
            mirror.reflection,
            mirror.axial_matrix,
            mirror.quaternion_matrix,
            mirror.hinge_matrix,
            mirror.module_matrix,
        ):
            np.testing.assert_array_equal(matrix @ matrix, np.eye(len(matrix)))


def test_the_geckos_legs_are_swapped_and_its_spine_bends_the_other_way():
    body, _ = compiled("gecko")
    (mirror,) = mirrors(body)
    paths = [module.path for module in body.walk() if module.kind == "hinge"]
    images = {path: paths[hinge] for path, hinge in zip(paths, mirror.hinges)}
    signs = dict(zip(paths, mirror.signs))
    spine = [path for path in paths if images[path] == path]
    assert images["core/left"] == "core/right"
    assert signs["core/left"] == signs["core/right"] == 1  # both lift by the same angle
    assert len(spine) == 2 and {signs[path] for path in spine} == {-1}


def with_bricks_at(left, right):
    """A body whose boxes stand in the same places whichever of two modules its last bricks hang on.

    Args:
        left: ``"hinge"`` or ``"brick"``, what the last brick on the left hangs on.
        right: likewise.
    """
    brick = {"module": "brick"}

    def limbs(hangs_on, inner):
        children = {inner: brick} if hangs_on == "brick" else {}
        behind = {"attachment": {"module": "brick", "children": children}}
        beside = {"attachment": brick} if hangs_on == "hinge" else {}
        return [{"module": "hinge", "children": limb} for limb in (behind, beside)]

    (behind_left, beside_left), (behind_right, beside_right) = (
        limbs(left, "right"),
        limbs(right, "left"),
    )
    front = {"module": "brick", "children": {"left": beside_left, "right": beside_right}}
    behind = {"front": front, "left": behind_left, "right": behind_right}
    return parse_body({"module": "core", "children": {"front": {**brick, "children": behind}}})


def test_what_touches_is_not_attached():
    assert planes(with_bricks_at("brick", "brick")) == ["x-z"]
    assert planes(with_bricks_at("hinge", "hinge")) == ["x-z"]
    assert planes(with_bricks_at("brick", "hinge")) == []


def test_a_body_may_have_a_diagonal_mirror_alone(pincers):
    assert planes(parse_body(pincers)) == ["x=y"]
