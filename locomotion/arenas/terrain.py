"""Ground that is not flat, without an end."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter

from locomotion.arenas.ground import Ground
from locomotion.arenas.periodic import TERRAIN
from locomotion.robots.geometry import FRICTION

#: Depth of the ground below its deepest place (m).
_BASE = 0.1


class Terrain(Ground):
    """A height field that goes on for ever: two periods of it are moved along under each robot.

    Whoever steps the model moves the body that carries it, as
    :func:`~locomotion.arenas.periodic.put_under` does: by whole periods, so the ground stays where it is.

    Args:
        heights: of one period (m), shape ``(cells, cells)``, rows along y, at most 0.
        cell: length of a cell (m).
        friction: coefficient of sliding friction.
        name: name of the arena's MJCF model.
    """

    def _build(
        self, heights: np.ndarray, cell: float, friction: float = FRICTION, name: str = TERRAIN
    ) -> None:
        super()._build(friction=friction, name=name)
        (plane,) = super().ground_geoms
        material = plane.material
        plane.remove()
        self._heights = np.asarray(heights, float)
        self._cell = cell
        self._period = cell * len(self._heights)
        root, lowest = self.mjcf_model, self._heights.min()
        depth = max(1e-6, np.ptp(self._heights))
        # A height field has a value at each corner of its cells, the last ones those of the first.
        twice = np.pad(np.tile(self._heights, (2, 2)), ((0, 1), (0, 1)), "wrap")
        field = root.asset.add(
            "hfield",
            name=TERRAIN,
            nrow=len(twice),
            ncol=len(twice),
            size=(self._period, self._period, depth, _BASE),
            elevation=" ".join(
                f"{value:.9g}" for value in ((twice[::-1] - lowest) / depth).ravel()
            ),
        )
        body = root.worldbody.add("body", name=TERRAIN, mocap=True, pos=(0, 0, lowest))
        self._geom = body.add(
            "geom",
            name="ground",
            type="hfield",
            hfield=field,
            material=material,
            friction=(friction,),
        )
        root.custom.add("numeric", name=TERRAIN, data=(self._period,))

    @property
    def period(self) -> float:
        """Length after which the ground goes on as it began, along x and along y (m)."""
        return self._period

    def highest(self, xy: np.ndarray, around: float) -> np.ndarray:
        """The highest ground (m) within a distance along x and y from places.

        Args:
            xy: places (m), shape ``(places, 2)``.
            around: the distance (m).
        """
        size = 2 * int(np.ceil(around / self._cell)) + 1
        top = maximum_filter(self._heights, size, mode="wrap")
        column, row = np.round((xy + self._period) / self._cell).astype(int).T % len(top)
        return top[row, column]
