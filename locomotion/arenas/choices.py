"""The arenas that a configuration can choose: options, and how an arena is made of them.

Nothing here imports dm-control, so that options are checked at once.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from locomotion.options.checked import Checked, key
from locomotion.options.registry import arenas

if TYPE_CHECKING:
    import numpy as np
    from dm_control import composer

#: Length of the cells of height fields (m): smooth ground needs fewer, and a step on them takes less time; edges
#: are as wide as a cell.
_SMOOTH, _SHARP = 0.1, 0.05
#: How far ground may rise over its length: no robot starts on more.
_MAX_SLOPE = 1.0


@arenas.register("ground")
@dataclasses.dataclass
class GroundConfig(Checked):
    """An endless plane."""

    PREFIX = "arena."

    def make(self, friction: float) -> composer.Arena:
        """Builds the arena.

        Args:
            friction: sliding friction of its surface.
        """
        from locomotion.arenas.ground import Ground

        return Ground(friction=friction)


@dataclasses.dataclass
class _TerrainConfig(Checked):
    """Ground that goes on as it began after a period, without an end."""

    PREFIX = "arena."
    CELL = _SHARP

    period: float = key(
        "length after which the ground goes on as it began (m)", default=4.0, least=2, most=20
    )

    growing: bool = key(
        "whether heights grow from 0 at the edges of a period to all of them in its middle",
        default=False,
    )

    @property
    def cells(self) -> int:
        """Cells of a period."""
        return max(2, round(self.period / self.CELL))

    def heights(self) -> np.ndarray:
        """Heights of a period (m), shape ``(cells, cells)``."""
        raise NotImplementedError

    def make(self, friction: float) -> composer.Arena:
        """Builds the arena; see :meth:`GroundConfig.make`."""
        from locomotion.arenas.heights import growing
        from locomotion.arenas.terrain import Terrain

        heights = growing(self.heights()) if self.growing else self.heights()
        return Terrain(heights, self.CELL, friction=friction)

    def _require_slope(self, slope: float, by: str) -> None:
        if slope > _MAX_SLOPE:
            steepest = f"{self.height * _MAX_SLOPE / slope:.3g}"
            self.refuse(
                "height",
                self.height,
                f"at most {steepest} with {by}: no robot starts on steeper ground",
            )


@arenas.register("rough")
@dataclasses.dataclass
class RoughConfig(_TerrainConfig):
    """Bumps of any shape."""

    CELL = _SMOOTH

    height: float = key("from the deepest place to the highest (m)", default=0.04, least=0, most=1)
    wavelength: float = key("length of the shortest bumps (m)", default=0.4, least=0.2, most=2)
    seed: int = key("of the bumps", default=0, least=0, most=2**31 - 1)

    def __post_init__(self) -> None:
        super().__post_init__()
        # That of a wave of the shortest length and half the height.
        slope = 3.1416 * self.height / self.wavelength / 2
        self._require_slope(slope, f"arena.wavelength={self.wavelength:g}")

    def heights(self) -> np.ndarray:
        from locomotion.arenas.heights import rough

        return rough(self.cells, self.period, self.height, self.wavelength, self.seed)


@arenas.register("slopes")
@dataclasses.dataclass
class SlopesConfig(_TerrainConfig):
    """Pyramids side by side."""

    CELL = _SMOOTH

    height: float = key("of a pyramid (m)", default=0.4, least=0, most=10)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_slope(2 * self.height / self.period, f"arena.period={self.period:g}")

    def heights(self) -> np.ndarray:
        from locomotion.arenas.heights import slopes

        return slopes(self.cells, self.height)


@arenas.register("steps")
@dataclasses.dataclass
class StepsConfig(_TerrainConfig):
    """Stairs up and down, on all sides of a square."""

    height: float = key("of a step (m)", default=0.03, least=0, most=1)
    tread: float = key("depth of a step (m)", default=0.4, least=0.1, most=5)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_slope(self.height / self.tread, f"arena.tread={self.tread:g}")

    def heights(self) -> np.ndarray:
        from locomotion.arenas.heights import steps

        return steps(self.cells, self.period, self.height, self.tread)


@arenas.register("stones")
@dataclasses.dataclass
class StonesConfig(_TerrainConfig):
    """Square stepping stones, with gaps of an eighth of their size between them."""

    height: float = key(
        "of the stones, and so the depth of the gaps (m)", default=0.05, least=0, most=1
    )
    size: float = key("of a stone and its gap (m)", default=0.4, least=0.4, most=5)

    def heights(self) -> np.ndarray:
        from locomotion.arenas.heights import stones

        return stones(self.cells, self.period, self.height, self.size)


@arenas.register("mix")
@dataclasses.dataclass
class MixConfig(_TerrainConfig):
    """Rough ground, a slope, stairs and stepping stones, a quarter of each period each."""

    height: float = key(
        "from the deepest place to the highest of each (m)", default=0.06, least=0, most=1
    )
    seed: int = key("of the rough ground", default=0, least=0, most=2**31 - 1)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_slope(8 * self.height / self.period, f"arena.period={self.period:g}")

    def heights(self) -> np.ndarray:
        from locomotion.arenas.heights import mix

        return mix(self.cells, self.period, self.height, self.seed)
