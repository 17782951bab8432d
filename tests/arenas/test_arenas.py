"""Robots in arenas of the user's own, and the task in arenas other than flat ground."""

import mujoco
import numpy as np
import pytest
import torch
from dm_control import composer

from locomotion.arenas.ground import Ground
from locomotion.envs import LocomotionEnv
from locomotion.robots import ModularRobot, load_robot
from locomotion.tasks import WalkAway, compile_model

try:
    from dm_control.locomotion.arenas.floors import Floor
except ModuleNotFoundError:  # labmaze, which has no wheel for Python 3.13
    Floor = None

pytestmark = pytest.mark.slow

ARENAS = [Ground, pytest.param(Floor, marks=pytest.mark.skipif(Floor is None, reason="no labmaze"))]

#: The outer modules are hinges, so that no geom is covered by a brick.
BARE = {
    "module": "core",
    "children": {
        face: {"module": "hinge", "children": {"attachment": {"module": "hinge"}}}
        for face in ("left", "right")
    },
}


class Terraces(composer.Arena):
    """Ground of boxes side by side along x, each as high as it is told."""

    def _build(self, heights=(0.0, 0.0), friction=1.0):
        super()._build(name="terraces")
        edges = np.arange(len(heights) + 1) * 2.0 - len(heights)
        self._geoms = tuple(
            self.mjcf_model.worldbody.add(
                "geom",
                name=f"terrace{number}",
                type="box",
                pos=(edges[number] + 1, 0, height - 1),
                size=(1, 5, 1),
                friction=(friction,),
            )
            for number, height in enumerate(heights)
        )

    @property
    def ground_geoms(self):
        return self._geoms


class Fenced(Ground):
    """Flat ground with a wall across the x axis."""

    def _build(self, distance=0.5, **options):
        super()._build(**options)
        self.mjcf_model.worldbody.add(
            "geom", name="wall", type="box", pos=(distance + 0.1, 0, 0.5), size=(0.1, 5, 0.5)
        )


def compiled(entity):
    return mujoco.MjModel.from_xml_string(entity.mjcf_model.to_xml_string())


def robot(name="gecko", body="gecko", **options):
    return ModularRobot(load_robot(body).body if isinstance(body, str) else body, name, **options)


def stand(env):
    """The readings after two seconds with all hinges at 0."""
    td = env.fake_tensordict()
    for _ in range(8):
        td = env.step(td.set("action", torch.zeros(env.action_spec.shape)))["next"]
    return td


@pytest.mark.parametrize("self_collision", [False, True])
@pytest.mark.parametrize("arena", ARENAS)
def test_two_robots_dropped_on_one_another_collide(arena, self_collision):
    arena = arena()
    for name, height in (("one", 0.1), ("two", 0.3)):
        frame = arena.add_free_entity(robot(name, self_collision=self_collision))
        frame.pos = (0, 0, height)
    model = compiled(arena)
    data = mujoco.MjData(model)
    touched = set()
    while data.time < 2:
        mujoco.mj_step(model, data)
        for contact in data.contact:
            names = (model.geom(geom).name.partition("/")[0] for geom in contact.geom)
            touched.add(frozenset(names))
    assert frozenset(("one", "two")) in touched
    # Both come to rest, one on the other, neither inside of the other or of the ground.
    lower, upper = data.body("one/").xpos[2], data.body("two/").xpos[2]
    assert lower > 0.028 and upper - lower > 0.05
    assert abs(data.qvel).max() < 0.1


@pytest.mark.parametrize("heights", [(0.0, 0.0), (0.0, 0.0, 0.0, 0.0), (0.3, 0.3)])
def test_a_robot_stands_on_ground_of_several_geoms(heights, stepping):
    """On whichever of them it is, and senses it."""
    task = WalkAway(robot(), Terraces(heights))
    env = LocomotionEnv(
        task, 3, physics=stepping, readings=["core_height", "ground_contact"], seed=0
    )
    places = torch.as_tensor(env.model.qpos0).repeat(3, 1)
    places[:, 0] = torch.tensor([-0.7, 0.0, 0.7])
    places[:, 2] += heights[0]
    env.set_state(places, torch.zeros(3, env.model.nv))
    td = stand(env)
    height = td["core_height"].cpu() - heights[0]
    torch.testing.assert_close(
        height, torch.full((3, 1), task.robot.standing_height), atol=2e-3, rtol=0
    )
    modules = list(task.robot.modules)
    assert td["ground_contact"][:, modules.index("core")].all()


def test_a_robot_falls_off_a_terrace():
    env = LocomotionEnv(WalkAway(robot(), Terraces((0.0, -1.0))), 2, readings=["core_height"])
    places = torch.as_tensor(env.model.qpos0).repeat(2, 1)
    places[:, 0] = torch.tensor([-0.5, 0.5])
    env.set_state(places, torch.zeros(2, env.model.nv))
    td = stand(env)
    high, low = td["core_height"].squeeze(-1).tolist()
    assert high == pytest.approx(0.03, abs=2e-3) and low == pytest.approx(-0.97, abs=2e-3)


def test_named_contacts_with_flat_ground_are_those_that_mujoco_finds():
    """Flat ground alone, and with a wall far away, for which MuJoCo looks for all contacts."""
    envs = [
        LocomotionEnv(WalkAway(robot("bare", BARE), arena), 4, seed=0)
        for arena in (Ground(), Fenced(50.0))
    ]
    walks = []
    for env in envs:
        torch.manual_seed(0)
        walks.append(env.rollout(12))
    torch.testing.assert_close(walks[0].to_dict(), walks[1].to_dict(), atol=1e-6, rtol=0)


@pytest.mark.parametrize(("make", "stopped"), [(Ground, False), (Fenced, True)])
def test_what_an_arena_has_besides_its_ground_is_in_the_way(make, stopped):
    env = LocomotionEnv(WalkAway(robot(friction=0.01), make(friction=0.01)), 1)
    speeds = torch.zeros(env.model.nv)
    speeds[0] = 3.0
    env.set_state(torch.as_tensor(env.model.qpos0), speeds)
    td = stand(env)
    assert (td["core_position"][0, 0] < 0.5) == stopped


def test_properties_of_a_ground_hold():
    """Soft ground, into which a robot sinks further."""

    class Soft(Ground):
        def _build(self, **options):
            super()._build(**options)
            self.ground_geoms[0].set_attributes(solref=(0.2, 1), priority=1)

    heights = []
    for arena in (Ground(), Soft()):
        model = compile_model(WalkAway(robot(), arena))
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 500)
        heights.append(data.qpos[2])
    assert heights[0] - heights[1] > 0.002


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_friction_is_that_of_the_ground_or_of_the_modules_whichever_is_more(friction):
    """A robot that slides to a halt, by Coulomb's law."""
    speed = 2.0
    for arena, modules in ((friction, 0.1), (0.1, friction)):
        model = compile_model(WalkAway(robot(friction=modules), Ground(friction=arena)))
        data = mujoco.MjData(model)
        data.qvel[0] = speed
        mujoco.mj_step(model, data, 300)
        expected = speed**2 / (2 * friction * 9.81)
        assert data.qpos[0] == pytest.approx(expected, rel=0.1)
