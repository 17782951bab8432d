"""Bodies: what is built is what was written, and what cannot exist is refused by name."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from locomotion.robots import (
    ActiveHinge,
    BodyError,
    Brick,
    Core,
    ModularRobot,
    load_robot,
    parse_body,
)
from locomotion.robots.body import placed_boxes
from locomotion.robots.geometry import GEOMETRY
from locomotion.tasks import WalkAway

HINGE = {"module": "hinge"}
BRICK = {"module": "brick"}


def compiled(entity):
    return mujoco.MjModel.from_xml_string(entity.mjcf_model.to_xml_string())


def core(**children):
    return {"module": "core", "children": children}


def hinge(child=None, **keys):
    return {**HINGE, **keys, **({"children": {"attachment": child}} if child else {})}


def brick(**children):
    return {**BRICK, "children": children}


@pytest.mark.parametrize(
    ("name", "hinges", "mass"),
    [("gecko", 6, 0.250 + 6 * 0.030 + 6 * 0.069), ("ant", 8, 0.250 + 8 * 0.030 + 8 * 0.069)],
)
def test_bundled_robots_have_the_reports_hinges_and_mass(name, hinges, mass):
    model = compiled(WalkAway(ModularRobot(load_robot(name).body)).root_entity)
    assert model.nu == model.njnt - 1 == hinges
    assert model.body_mass.sum() == pytest.approx(mass)
    np.testing.assert_allclose(
        model.jnt_range[1:], [[-1.047197551, 1.047197551]] * hinges, atol=1e-9
    )
    np.testing.assert_allclose(model.actuator_forcerange, [[-0.948013269, 0.948013269]] * hinges)


@pytest.mark.parametrize("name", ["gecko", "ant"])
def test_compiled_boxes_stand_where_the_body_tree_says(name):
    robot = ModularRobot(load_robot(name).body)
    model = compiled(robot)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    boxes = list(placed_boxes(robot.body))
    assert len(boxes) == model.ngeom
    for module, box, centre, lengths in boxes:
        geom = model.geom(f"{module.path}/{box.name}").id
        axes = np.abs(data.geom_xmat[geom].reshape(3, 3))
        np.testing.assert_allclose(data.geom_xpos[geom], centre, atol=1e-9)
        np.testing.assert_allclose(2 * axes @ model.geom_size[geom], lengths, atol=1e-9)


def test_modules_can_be_used_alone():
    for entity, faces in (
        (Core(), {"front", "left", "back", "right"}),
        (Brick(), {"front", "left", "right"}),
        (ActiveHinge(), {"attachment"}),
    ):
        assert set(entity.attachment_sites) == faces
        compiled(entity)


def test_names_and_order_of_hinges_do_not_depend_on_the_spelling():
    one = ModularRobot(core(left=hinge(), back=hinge(brick(right=hinge()))), name="worm")
    other = ModularRobot(core(back=hinge(brick(right=hinge())), left=hinge()), name="worm")
    paths = ["core/left", "core/back", "core/back/attachment/right"]
    assert list(one.hinges) == list(other.hinges) == paths
    model = compiled(one)
    assert [model.joint(i).name for i in range(3)] == [f"{path}/hinge" for path in paths]
    assert [model.actuator(i).name for i in range(3)] == [f"{path}/servo" for path in paths]


def loop():
    """A chain of bricks that turns left until it runs into itself."""
    return core(left=brick(left=brick(left=brick(left=brick(left=BRICK)))), right=HINGE)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (core(left={"module": "leg"}), "core/left: unknown module 'leg'"),
        (core(left=hinge({"module": "wheel"})), "core/left/attachment: unknown module 'wheel'"),
        (core(left={}), "core/left: unknown module None"),
        (core(top=HINGE), "core: a core has no face 'top'"),
        (core(left=hinge(brick(back=BRICK))), "core/left/attachment: a brick has no face 'back'"),
        (core(left={**HINGE, "children": {"front": BRICK}}), "core/left: a hinge has no face"),
        (core(left=BRICK), "core: the body has no hinge"),
        ({"module": "core"}, "core: the body has no hinge"),
        (core(left=hinge(rotation=45)), "core/left: rotation 45 is not a quarter turn"),
        (core(left=hinge(rotation="90")), "core/left: rotation '90' is not a quarter turn"),
        (core(left=hinge(rotation=float("nan"))), "core/left: rotation nan is not a quarter turn"),
        (core(left=hinge(angle=90)), "core/left: unknown key 'angle'"),
        (core(left=hinge({"module": "core"})), "core/left/attachment: a body has one core"),
        (brick(left=HINGE), "core: a body starts from a core"),
        (core(left=None), "core/left: expected a module"),
        (core(left=[HINGE, HINGE]), "core/left: expected a module"),
        ({"module": "core", "children": [HINGE]}, "core: children must map faces to modules"),
        (loop(), "stands in the same place as core"),
    ],
)
def test_a_body_that_cannot_exist_is_refused_by_the_modules_path(body, message):
    with pytest.raises(BodyError, match="^core") as caught:
        parse_body(body)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def trees(kind):
    """Random trees from a module kind down, faulty rotations among them."""
    rotation = st.sampled_from([0, 90, 180, 270, -90, 0, 90, 45])

    def node(kind, depth):
        below = [k for k in ("brick", "hinge") if depth > 0]
        child = st.deferred(lambda: st.one_of([node(k, depth - 1) for k in below]))
        faces = GEOMETRY[kind].faces
        children = (
            st.dictionaries(st.sampled_from(sorted(faces)), child, max_size=3)
            if below
            else st.just({})
        )
        return st.fixed_dictionaries(
            {"module": st.just(kind), "rotation": rotation, "children": children}
        )

    return node(kind, 4)


@settings(max_examples=60, deadline=None)
@given(trees("core"))
def test_any_tree_is_refused_by_name_or_moves_without_trouble(tree):
    try:
        robot = ModularRobot(tree)
    except BodyError as error:
        assert str(error).startswith("core")
        return
    model = compiled(WalkAway(robot).root_entity)
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.5
    mujoco.mj_step(model, data, 10)
    assert np.isfinite(data.qpos).all()
    assert not any(warning.number for warning in data.warning)
    names = [model.joint(i).name for i in range(1, model.njnt)]
    assert names == [f"robot/{path}/hinge" for path in robot.hinges]
