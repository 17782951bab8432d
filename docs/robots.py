"""Draws docs/robots.png: ``MUJOCO_GL=egl python docs/robots.py``; ``glfw`` where there is a screen."""

from pathlib import Path

import mujoco
from matplotlib.figure import Figure

from locomotion.robots import ModularRobot, load_robot
from locomotion.tasks import WalkAway


def picture(name):
    robot = load_robot(name)
    arena = WalkAway(ModularRobot(robot.body, name=robot.name)).root_entity.mjcf_model
    getattr(arena.visual, "global").set_attributes(offwidth=960, offheight=720)
    arena.visual.quality.shadowsize = 4096
    model = mujoco.MjModel.from_xml_string(arena.to_xml_string())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = data.subtree_com[0] + (0, 0, -0.02)
    camera.distance, camera.azimuth, camera.elevation = 0.85, 145, -35
    with mujoco.Renderer(model, 720, 960) as renderer:
        renderer.update_scene(data, camera)
        return renderer.render()


figure = Figure(figsize=(10, 3.95), layout="constrained")
for axis, name in zip(figure.subplots(1, 2), ("gecko", "ant")):
    axis.imshow(picture(name))
    axis.set_title(name)
    axis.axis("off")
figure.savefig(Path(__file__).with_name("robots.png"), dpi=110)
