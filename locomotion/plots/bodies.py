"""Bodies from above, drawn without a simulator."""

from __future__ import annotations

import math
from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from locomotion.robots.body import Module, placed_boxes

_COLOURS = {"core": "#c0392b", "brick": "#2e6fa7", "hinge": "#8a8f98"}
#: Bodies in a row.
_COLUMNS = 6


def bodies(found: Mapping[str, Module]) -> Figure:
    """Draws bodies from above, all to one scale: core red, bricks blue, hinges grey.

    A black bar is the axis of a hinge that lifts; a black dot that of one that turns sideways.

    Args:
        found: the cores of bodies, by name.
    """
    columns = min(_COLUMNS, len(found))
    rows = math.ceil(len(found) / columns)
    figure = Figure(figsize=(2.1 * columns, 2.2 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).flatten()
    reach = max(_draw(axis, body) for axis, body in zip(axes, found.values(), strict=False))
    for axis, name in zip(axes, found, strict=False):
        axis.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", title=name)
    for axis in axes:
        axis.axis("off")
    return figure


def _draw(axis: Axes, body: Module) -> float:
    """Draws one body about the middle of what it covers; returns half its longer side (m)."""
    boxes = sorted(placed_boxes(body), key=lambda found: found[2][2] + found[3][2] / 2)
    lows = [min(centre[i] - lengths[i] / 2 for _, _, centre, lengths in boxes) for i in (0, 1)]
    highs = [max(centre[i] + lengths[i] / 2 for _, _, centre, lengths in boxes) for i in (0, 1)]
    middle = [(low + high) / 2 for low, high in zip(lows, highs, strict=True)]
    for module, box, centre, lengths in boxes:
        x, y = centre[0] - middle[0], centre[1] - middle[1]
        # The core's front is drawn upwards.
        corner, size = (-y - lengths[1] / 2, x - lengths[0] / 2), (lengths[1], lengths[0])
        colour = _COLOURS[module.kind]
        axis.add_patch(Rectangle(corner, *size, facecolor=colour, edgecolor="white", linewidth=0.4))
        if box.name == "servo":
            along = [abs(length - box.lengths[1]) < 1e-9 for length in lengths]
            if along[2]:
                axis.plot(-y, x, "k.", markersize=3)
            else:
                half = [0.5 * length * here for length, here in zip(lengths, along, strict=True)]
                axis.plot([-y - half[1], -y + half[1]], [x - half[0], x + half[0]], "k", lw=1)
    return max(high - low for low, high in zip(lows, highs, strict=True)) / 2
