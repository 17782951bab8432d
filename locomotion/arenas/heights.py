"""Heights of periodic ground, as arrays.

Each function returns heights (m) between ``-height`` and 0, of shape ``(cells, cells)``, rows along y. They
go on as they began: cell 0 follows the last one.
"""

from __future__ import annotations

import numpy as np


def rough(cells: int, period: float, height: float, wavelength: float, seed: int) -> np.ndarray:
    """Bumps of any shape: waves in all directions, none of them shorter than a wavelength.

    Args:
        cells: along each side.
        period: length of a side (m).
        height: from the deepest place to the highest (m).
        wavelength: of the shortest waves (m); there are some of four times the length too.
        seed: of the waves.
    """
    # Noise, of which only the long waves are left; those of a whole number of periods meet at the edges.
    noise = np.fft.rfft2(np.random.default_rng(seed).standard_normal((cells, cells)))
    along_y = np.fft.fftfreq(cells, period / cells)[:, None]
    along_x = np.fft.rfftfreq(cells, period / cells)
    frequency = np.hypot(along_y, along_x)
    kept = (frequency <= 1 / wavelength) & (frequency >= 0.25 / wavelength)
    return _between(np.fft.irfft2(noise * kept, (cells, cells)), height)


def slopes(cells: int, height: float) -> np.ndarray:
    """Pyramids side by side, whose sides rise by a height over half a period.

    Args:
        cells: along each side.
        height: of a pyramid (m).
    """
    return -2 * height * _distance_from_middle(cells)


def steps(cells: int, period: float, height: float, tread: float) -> np.ndarray:
    """Stairs up to the middle of each period and down again, from all sides.

    Args:
        cells: along each side.
        period: length of a side (m).
        height: of a step (m).
        tread: depth of a step (m).
    """
    return -height * np.round(_distance_from_middle(cells) * period / tread)


def stones(cells: int, period: float, height: float, size: float) -> np.ndarray:
    """Square stones with gaps between them, an eighth as wide.

    Args:
        cells: along each side.
        period: length of a side (m).
        height: of the stones, and so the depth of the gaps (m).
        size: of a stone with its gap (m); as many as come nearest to it fit into a period.
    """
    count = max(1, round(period / size))
    within = (np.arange(cells) + 0.5) * count / cells % 1
    gap = within > 1 - 1 / 8
    return -height * (gap[:, None] | gap).astype(float)


def mix(cells: int, period: float, height: float, seed: int) -> np.ndarray:
    """Rough ground, a slope, stairs and stones, a quarter of each period each, all of one height.

    Args:
        cells: along each side.
        period: length of a side (m).
        height: of each (m).
        seed: of the rough ground.
    """
    half, side = cells // 2, period / 2
    quarters = [
        rough(half, side, height, side / 8, seed),
        _between(slopes(half, height), height),
        _between(steps(half, side, height / 4, side / 8), height),
        stones(half, side, height, side / 6),
    ]
    # Each quarter falls off towards its edges, so that none ends in a wall.
    inside = np.clip((0.5 - _distance_from_middle(half)) * 8, 0, 1)
    quarters = [(quarter + height) * inside - height for quarter in quarters]
    return np.block([quarters[:2], quarters[2:]])


def growing(heights: np.ndarray) -> np.ndarray:
    """Heights that grow from 0 at the edges to all of them in the middle."""
    return heights * (1 - 2 * _distance_from_middle(len(heights)))


def _distance_from_middle(cells: int) -> np.ndarray:
    """Of each cell, the larger one of both directions, in periods: 0 to a half."""
    along = np.abs((np.arange(cells) + 0.5) / cells - 0.5)
    return np.maximum(along[:, None], along)


def _between(values: np.ndarray, height: float) -> np.ndarray:
    """Values scaled so that they lie between ``-height`` and 0."""
    span = values.max() - values.min()
    return height * (values - values.max()) / span if span else 0.0 * values
