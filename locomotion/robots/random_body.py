"""Bodies drawn at random, for those who search over bodies."""

from __future__ import annotations

from typing import Any

import numpy as np

from locomotion.robots.body import BodyError, parse_body
from locomotion.robots.geometry import GEOMETRY

#: How often a place for a module is looked for before a body is left as it is.
_ATTEMPTS = 200


def random_body(seed: int, max_hinges: int = 8, max_bricks: int = 8) -> dict[str, Any]:
    """Draws a body tree; the same seed and limits give the same one.

    Modules are attached one after another to free faces, in any quarter turn, where they stand in no other's
    place.

    Args:
        seed: of the drawing.
        max_hinges: most hinges, at least 1; there are at least half as many.
        max_bricks: most bricks, at least 0; there may be none.

    Returns:
        A tree as :func:`~locomotion.robots.parse_body` reads it.
    """
    draw = np.random.default_rng(seed)
    hinges = int(draw.integers(max(1, max_hinges // 2), max_hinges + 1))
    wanted = ["hinge"] * hinges + ["brick"] * int(draw.integers(0, max_bricks + 1))
    # A hinge first, without which nothing is a body.
    order = [wanted[0], *draw.permutation(wanted[1:]).tolist()]
    core: dict[str, Any] = {"module": "core", "children": {}}
    free = [(core, face) for face in GEOMETRY["core"].faces]
    attempts = 0
    while order and free and attempts < _ATTEMPTS:
        attempts += 1
        number = int(draw.integers(len(free)))
        parent, face = free[number]
        child = {"module": order[0], "rotation": 90 * int(draw.integers(4)), "children": {}}
        parent["children"][face] = child
        try:
            parse_body(core)
        except BodyError:
            del parent["children"][face]
            continue
        del order[0], free[number]
        free += [(child, name) for name in GEOMETRY[child["module"]].faces]
    return _without_empty(core)


def _without_empty(tree: dict[str, Any]) -> dict[str, Any]:
    kept = {name: value for name, value in tree.items() if value not in (0, {})}
    if "children" in kept:
        kept["children"] = {face: _without_empty(c) for face, c in kept["children"].items()}
    return kept
