"""A film of a robot that walks."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Self

import av
import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from locomotion.arenas.periodic import put_under
from locomotion.options import ConfigError
from locomotion.rendering.graphics import ADVICE, open_context
from locomotion.rendering.motion import Motion
from locomotion.writing import atomic_write

_PATH_COLOUR = np.array([0.93, 0.35, 0.12, 1.0], np.float32)
#: Room in the scene for the path; it is thinned to this number of pieces.
_MAX_PIECES = 400
_MAX_GEOMS = 10_000
#: The small moving picture next to a film: its first seconds, pictures a second, width in pixels.
_SMALL_SECONDS, _SMALL_FPS, _SMALL_WIDTH = 10.0, 12.5, 480
#: Of moving pictures.
_QUALITY = 55


def draw(motion: Motion, width: int, height: int) -> Iterator[np.ndarray]:
    """Draws picture after picture, ``(height, width, 3)`` bytes: the robot, followed by a camera.

    The core's path is drawn on the ground; control step, time and speed stand in the corner.

    Raises:
        ConfigError: if this machine cannot draw.
    """
    model = copy.copy(motion.model)  # whoever gave it may still use it
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    model.vis.quality.shadowsize = 1024  # larger ones take most of the time without a GPU
    sun = model.nlight and model.light_type[0] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    if sun:
        # Its shadows end near where it stands, and the ground is speckled there.
        model.light_type[0] = mujoco.mjtLightType.mjLIGHT_SPOT
    camera = mujoco.MjvCamera()
    camera.distance, camera.azimuth, camera.elevation = 1.25, 120.0, -22.0
    font = ImageFont.load_default(max(10, height // 26))
    data = mujoco.MjData(model)
    with _Canvas(model, width, height) as canvas:
        for picture, qpos in enumerate(motion.qpos):
            data.qpos[:] = qpos
            put_under(model, data)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_camlight(model, data)
            if sun:
                _light_from_above(data, motion.follow(picture))
            camera.lookat[:2] = motion.follow(picture)
            camera.lookat[2] = 0.05
            pixels = canvas.draw(data, camera, motion.place[: picture + 1])
            yield _captioned(pixels, motion, picture, font)


class _Canvas:
    """Draws scenes, with whatever OpenGL there is; MuJoCo's ``Renderer`` takes that of its import."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        self._opengl = open_context(width, height)
        try:
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        except Exception as error:
            self._opengl.free()
            reason = " ".join(str(error).split())
            raise ConfigError(f"{ADVICE} (MuJoCo says: {reason})") from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._model, self._scene = model, mujoco.MjvScene(model, maxgeom=_MAX_GEOMS)
        self._options, self._perturbation = mujoco.MjvOption(), mujoco.MjvPerturb()
        self._frame = mujoco.MjrRect(0, 0, width, height)

    def draw(self, data: mujoco.MjData, camera: mujoco.MjvCamera, places: np.ndarray) -> np.ndarray:
        """Draws a state and a path on the ground."""
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(
            self._model, data, self._options, self._perturbation, camera, everything, self._scene
        )
        _add_path(self._scene, places)
        self._opengl.make_current()  # between two pictures somebody else may draw
        mujoco.mjr_render(self._frame, self._scene, self._context)
        pixels = np.empty((self._frame.height, self._frame.width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._frame, self._context)
        return pixels[::-1]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._opengl.make_current()
        self._context.free()
        self._opengl.free()


def write_film(
    motion: Motion,
    path: Path | str,
    width: int = 800,
    height: int = 450,
    progress: Callable[[], object] = lambda: None,
) -> list[Path]:
    """Writes a film: ``.mp4``, with a small ``.webp`` of its first seconds under the same name next to
    it, or a ``.webp`` or ``.gif`` alone.

    Args:
        motion: what to show.
        path: where to.
        width: in pixels, even.
        height: in pixels, even.
        progress: called after each picture.

    Returns:
        The files.

    Raises:
        ConfigError: if this machine cannot draw.
    """

    def drawn() -> Iterator[np.ndarray]:
        for picture in draw(motion, width, height):
            yield picture
            progress()

    path = Path(path)
    if path.suffix != ".mp4":
        _animate(path, [Image.fromarray(picture) for picture in drawn()], motion.fps)
        return [path]

    every = max(1, round(motion.fps / _SMALL_FPS))
    small: list[Image.Image] = []

    def keep(number: int, picture: np.ndarray) -> None:
        if number % every == 0 and number < _SMALL_SECONDS * motion.fps:
            size = (_SMALL_WIDTH, round(_SMALL_WIDTH * height / width))
            small.append(Image.fromarray(picture).resize(size, Image.Resampling.LANCZOS))

    with atomic_write(path) as partial:
        _encode(partial, motion.fps, width, height, drawn(), keep)
    small_path = path.with_suffix(".webp")
    _animate(small_path, small, motion.fps / every)
    return [path, small_path]


def _animate(path: Path, pictures: list[Image.Image], fps: float) -> None:
    with atomic_write(path) as partial:
        pictures[0].save(
            partial,
            save_all=True,
            append_images=pictures[1:],
            duration=round(1000 / fps),
            loop=0,
            quality=_QUALITY,
            method=4,
        )


def _encode(
    path: Path,
    fps: float,
    width: int,
    height: int,
    pictures: Iterator[np.ndarray],
    keep: Callable[[int, np.ndarray], None],
) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.options = {"crf": "23", "movflags": "+faststart"}
        for number, picture in enumerate(pictures):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            keep(number, picture)
        container.mux(stream.encode())


def _light_from_above(data: mujoco.MjData, place: np.ndarray) -> None:
    """Moves the light along with the robot."""
    direction = data.light_xdir[0]
    data.light_xpos[0] = np.array([*place, 0.0]) - direction * (3.0 / -direction[2])


def _add_path(scene: mujoco.MjvScene, places: np.ndarray) -> None:
    """Draws where the core has been, just above the ground."""
    thinned = places[:: max(1, -(-len(places) // _MAX_PIECES))]
    for one, other in itertools.pairwise(thinned):
        if scene.ngeom == scene.maxgeom:
            return
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(
            geom,
            mujoco.mjtGeom.mjGEOM_CAPSULE,
            np.zeros(3),
            np.zeros(3),
            np.zeros(9),
            _PATH_COLOUR,
        )
        mujoco.mjv_connector(
            geom,
            mujoco.mjtGeom.mjGEOM_CAPSULE,
            0.004,
            np.array([*one, 0.002]),
            np.array([*other, 0.002]),
        )
        scene.ngeom += 1


def _captioned(
    picture: np.ndarray, motion: Motion, number: int, font: ImageFont.FreeTypeFont
) -> np.ndarray:
    image = Image.fromarray(picture)
    text = (
        f"step {motion.control_step[number]}   {number / motion.fps:.1f} s"
        f"   {motion.speed_at(number):.2f} m/s"
    )
    margin = font.size * 0.7
    ImageDraw.Draw(image).text(
        (margin, margin), text, font=font, fill="white", stroke_width=2, stroke_fill=(40, 40, 40)
    )
    return np.asarray(image)
