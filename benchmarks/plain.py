"""A task without what makes its physics step cheap: MuJoCo's plain defaults."""

from __future__ import annotations

import copy

import mujoco

from locomotion.tasks import WalkAway


def undo_savings(task: WalkAway, fused: bool = False) -> WalkAway:
    """Takes back what the project says in a task's MJCF to save time; returns the task.

    MuJoCo then searches for contacts with the ground, starts its solver from the last step and looks for
    islands; what touches what is as before, but for end plates behind bricks, which touch the ground too.

    Args:
        task: a task whose arena has one ground; it is changed.
        fused: keep modules fused that do not move against one another.
    """
    root, robot = task.root_entity.mjcf_model, task.robot.mjcf_model
    for pair in root.contact.get_children("pair"):
        pair.remove()
    for geom in robot.find_all("geom"):
        geom.conaffinity |= 1  # the ground's type of contact
    del root.option.flag.island, root.option.flag.warmstart
    if not fused:
        for model in (root, robot):
            model.compiler.fusestatic = False
    return task


def plain_model(task: WalkAway) -> mujoco.MjModel:
    """The compiled model, with all that is only needed to put it together; sensors are left out.

    Args:
        task: as :func:`undo_savings` returns it.
    """
    spec = mujoco.MjSpec.from_string(task.root_entity.mjcf_model.to_xml_string())
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    return spec.compile()


def with_numerics_of(model: mujoco.MjModel, source: mujoco.MjModel) -> mujoco.MjModel:
    """A copy of a model whose contacts are as soft, and whose solver starts as cold, as another's.

    MuJoCo scales the softness of a contact by the inverse weight of the body that the geom is part
    of, which fusing bodies changes. What is then left between two models should be bookkeeping.
    """
    model = copy.copy(model)
    model.opt.disableflags = source.opt.disableflags
    for geom in range(model.ngeom):
        body = source.geom(model.geom(geom).name).bodyid
        model.body_invweight0[model.geom_bodyid[geom]] = source.body_invweight0[body]
    return model
