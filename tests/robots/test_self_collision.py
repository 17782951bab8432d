"""Whether limbs collide with one another, in plain MuJoCo with whatever arena."""

import mujoco
import pytest
from dm_control import composer

from locomotion.arenas.ground import Ground
from locomotion.robots import ModularRobot
from locomotion.tasks import WalkAway


class Terraces(composer.Arena):
    """Ground of two boxes."""

    def _build(self):
        super()._build(name="terraces")
        self.ground_geoms = tuple(
            self.mjcf_model.worldbody.add("geom", type="box", size=(1, 1, 1), pos=(x, 0, -1))
            for x in (-1, 1)
        )


def in_an_arena_of_ones_own(robot):
    arena = composer.Arena()
    arena.add_free_entity(robot)
    return arena


PLACES = {
    "an arena of one's own": in_an_arena_of_ones_own,
    "flat ground": lambda robot: WalkAway(robot, Ground()).root_entity,
    "several ground geoms": lambda robot: WalkAway(robot, Terraces()).root_entity,
}


def close(arena, targets):
    """Sends hinges to targets, in the air.

    Returns:
        The pairs of bodies that touched one another; the model and the data at the end.
    """
    model = mujoco.MjModel.from_xml_string(arena.mjcf_model.to_xml_string())
    model.opt.gravity[:] = 0
    data = mujoco.MjData(model)
    data.qpos[2] = 5.0
    data.ctrl[:] = targets
    touched = set()
    while data.time < 3:
        mujoco.mj_step(model, data)
        touched |= {frozenset(model.geom_bodyid[contact.geom].tolist()) for contact in data.contact}
    return touched, model, data


@pytest.mark.parametrize("place", PLACES)
def test_limbs_that_meet_collide_only_if_they_are_told_to(place, pincers, closed):
    angles = {}
    for self_collision in (False, True):
        robot = ModularRobot(pincers, name="one", self_collision=self_collision)
        touched, model, data = close(PLACES[place](robot), closed)
        angles[self_collision] = [
            data.joint(f"one/core/{face}/hinge").qpos[0] for face in ("front", "left")
        ]
        limbs = frozenset(model.body(f"one/core/{face}/arm").id for face in ("front", "left"))
        # Not even the two sides of a hinge touch, which overlap.
        assert touched == ({limbs} if self_collision else set())
    assert angles[False] == pytest.approx(list(closed), abs=0.01)  # through one another
    assert all(abs(angle) < 0.95 for angle in angles[True])
