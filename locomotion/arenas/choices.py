"""The arenas that a configuration can choose: options, and how an arena is made of them.

Nothing here imports dm-control, so that options are checked at once.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from locomotion.options.checked import Checked
from locomotion.options.registry import arenas

if TYPE_CHECKING:
    from dm_control import composer


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
