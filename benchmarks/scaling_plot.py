"""The picture of :mod:`benchmarks.scaling`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.scaling_cells import Cell
from locomotion.writing import atomic_write

_COLOURS = ("#0072B2", "#D55E00")  # Okabe and Ito's


def draw(cells: Sequence[Cell], at: int, path: Path) -> None:
    """Draws time and memory over robots, and time over hinges.

    Args:
        cells: the table.
        at: how many robots each body has, where bodies are compared.
        path: of the picture.
    """
    usual = cells[0].hinges
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    time, memory, bodies = figure.subplots(1, 3)
    robots = [cell for cell in cells if cell.hinges == usual]
    compared = [cell for cell in cells if cell.robots == at]
    over_robots = (lambda cell: cell.robots, f"robots of {usual} hinges")
    over_hinges = (lambda cell: cell.hinges, f"hinges of each of {at:,} robots")
    _lines(time, robots, *over_robots)
    _lines(bodies, compared, *over_hinges)
    for cores, colour in zip(sorted({cell.cores for cell in cells}), _COLOURS, strict=False):
        chosen = [cell for cell in robots if cell.cores == cores]
        memory.loglog(
            [cell.robots for cell in chosen], [cell.memory for cell in chosen], "o-", color=colour
        )
    memory.set(xlabel=over_robots[1], ylabel="memory of the process (GB)")
    time.set(ylabel="a robot's control step (µs)")
    time.set_xscale("log")
    time.legend(frameon=False, fontsize="small")
    for axes in (time, memory, bodies):
        axes.spines[["top", "right"]].set_visible(False)
    with atomic_write(path) as partial:
        figure.savefig(partial, dpi=150, format=path.suffix.lstrip(".") or "png")


def _lines(
    axes: Axes,
    cells: Sequence[Cell],
    of: Callable[[Cell], int],
    label: str,
) -> None:
    for cores, colour in zip(sorted({cell.cores for cell in cells}), _COLOURS, strict=False):
        chosen = sorted((cell for cell in cells if cell.cores == cores), key=of)
        over = [of(cell) for cell in chosen]
        name = f"{cores} core{'s' * (cores > 1)}"
        axes.plot(over, [cell.microseconds for cell in chosen], "o-", color=colour, label=name)
        physics = [cell.microseconds * cell.parts["physics"] for cell in chosen]
        axes.plot(over, physics, ":", color=colour, label=f"of which MuJoCo, {name}")
    axes.set_ylim(bottom=0)
    axes.set_xlabel(label)
