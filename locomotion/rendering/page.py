"""A page that plays a gait in the browser: one file, which needs neither a server nor the internet."""

from __future__ import annotations

import io
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path

import mujoco
import numpy as np
import viser

from locomotion.arenas.periodic import put_under
from locomotion.rendering.motion import Motion
from locomotion.writing import atomic_write

#: Lines on the ground are a module's width apart, roughly (m).
_CELL = 0.1
#: How far the ground reaches beyond the path (m).
_MARGIN = 2.0


def write_page(
    motion: Motion, path: Path | str, progress: Callable[[], object] = lambda: None
) -> None:
    """Writes the page. The mouse turns the view, moves it and zooms.

    The ground moves under the robot, which stays in view.

    Args:
        motion: what to show.
        path: where to.
        progress: called after each picture.
    """
    # viser says where it listens, but nobody needs to go there.
    with redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        server.initial_camera.position = (0.6, -1.0, 0.55)
        server.initial_camera.look_at = (0.0, 0.0, 0.05)
        server.scene.set_up_direction("+z")
        _add_ground(server, motion)
        bodies = _add_bodies(server, motion.model)
        data = mujoco.MjData(motion.model)
        recording = server.get_scene_serializer()
        ground = server.scene.add_frame("/ground", show_axes=False)
        for picture, qpos in enumerate(motion.qpos):
            data.qpos[:] = qpos
            put_under(motion.model, data)
            mujoco.mj_kinematics(motion.model, data)
            middle = np.array([*motion.follow(picture), 0.0])
            with server.atomic():
                ground.position = -middle
                for body, frame in bodies.items():
                    frame.position = data.xpos[body] - middle
                    frame.wxyz = data.xquat[body].copy()
            recording.insert_sleep(1 / motion.fps)
            progress()
        with atomic_write(Path(path)) as partial:
            partial.write_text(recording.as_html(), encoding="utf-8")
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()


def _add_bodies(server: viser.ViserServer, model: mujoco.MjModel) -> dict[int, viser.FrameHandle]:
    """A frame for each body that moves, with its boxes below; returned by the body's number."""
    frames = {}
    for body in range(1, model.nbody):
        if model.body_mocapid[body] >= 0:
            frames[body] = _add_terrain(server, model)
            continue
        place = f"/robot/{body}"
        frames[body] = server.scene.add_frame(place, show_axes=False)
        first = model.body_geomadr[body]
        for geom in range(first, first + model.body_geomnum[body]):
            server.scene.add_box(
                f"{place}/{geom}",
                dimensions=tuple(2 * model.geom_size[geom]),
                color=tuple(model.geom_rgba[geom, :3]),
                position=model.geom_pos[geom],
                wxyz=model.geom_quat[geom],
            )
    return frames


def _add_terrain(server: viser.ViserServer, model: mujoco.MjModel) -> viser.FrameHandle:
    """The surface of a height field, below a frame of its own."""
    rows, columns = int(model.hfield_nrow[0]), int(model.hfield_ncol[0])
    half_x, half_y, height, _ = model.hfield_size[0]
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    z = height * model.hfield_data[: rows * columns]
    corner = np.arange(rows * columns).reshape(rows, columns)
    one, right, up, across = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    faces = np.stack([one, right, across, one, across, up], -1).reshape(-1, 3)
    frame = server.scene.add_frame("/robot/terrain", show_axes=False)
    server.scene.add_mesh_simple(
        "/robot/terrain/surface",
        vertices=np.stack([x.ravel(), y.ravel(), z], 1).astype(np.float32),
        faces=faces.astype(np.uint32),
        color=(168, 176, 184),
        flat_shading=True,
    )
    return frame


def _add_ground(server: viser.ViserServer, motion: Motion) -> None:
    """A grid around the path, and the path itself, below a frame of their own."""
    low, high = motion.place.min(0) - _MARGIN, motion.place.max(0) + _MARGIN
    centre = (low + high) / 2
    server.scene.add_frame("/ground", show_axes=False)
    server.scene.add_grid(
        "/ground/grid",
        width=float(high[0] - low[0]),
        height=float(high[1] - low[1]),
        cell_size=_CELL,
        section_size=10 * _CELL,
        position=(*centre, 0.0),
    )
    path = np.column_stack([motion.place, np.full(len(motion.place), 0.002)]).astype(np.float32)
    server.scene.add_line_segments(
        "/ground/path",
        points=np.stack([path[:-1], path[1:]], 1),
        colors=(237, 89, 31),
        thickness=3.0,
        thickness_units="screen",
    )
