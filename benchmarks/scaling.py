"""Measures what a control step costs as work grows: ``python -m benchmarks.scaling``.

Each line of the table is training in a process of its own, with its own peak of memory.
"""

from __future__ import annotations

import argparse
import itertools
import json
import multiprocessing
import os
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tqdm import tqdm

from benchmarks.arguments import Parser
from benchmarks.rows import aligned, load, machine, usable_cores
from benchmarks.scaling_cells import Cell, measure_cell, write_body

DESCRIPTION = (
    "Measures time and memory of a control step from 64 to 65,536 robots and 5 to 40 hinges."
)
ROBOTS = (64, 256, 1024, 4096, 16_384, 65_536)
#: Hinges of the bodies that as many robots have, as a reader of the table compares them.
HINGES, AT = (5, 10, 20, 40), 1024
#: Hinges of the body of which there are ever more, as many as the Ant has.
USUAL = 8
HEAD = ("robots", "hinges", "cores", "us", *Cell.PARTS, "memory (GB)")

NOTES = """\
A control step of one robot in training, with everything: MuJoCo, environment and transforms, the policy,
storage, and its share of the update with the report's epochs and minibatches. Memory: the most that the
process ever took."""


def main() -> None:
    """Measures what the command line asks for, and prints the table."""
    parser = Parser("benchmarks.scaling", DESCRIPTION, "two numbers of robots and of hinges")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the table there")
    for name, usual in (("robots", ROBOTS), ("hinges", HINGES)):
        words = f"numbers of {name} (default: {' '.join(map(str, usual))})"
        parser.add_argument(f"--{name}", nargs="+", type=int, default=usual, help=words)
    arguments = parser.parse_args()
    for name, least, most in (("robots", 1, 1_000_000), ("hinges", 4, 100)):
        for value in getattr(arguments, name):
            if not least <= value <= most:
                parser.error(f"--{name} {value} must be at least {least} and at most {most}")
    os.environ.setdefault("MUJOCO_GL", "disabled")
    started, about = time.perf_counter(), {**machine(), "load at the start": load()}
    with tempfile.TemporaryDirectory(prefix="scaling_") as folder:
        cells = []
        for cell in tqdm(planned(arguments, Path(folder)), disable=None):
            cells.append(measured(cell))
            # Shown at once, so that an interruption loses no line.
            tqdm.write("  ".join(cells[-1].cells()), file=sys.stderr)
    about |= {"load at the end": load(), "seconds": f"{time.perf_counter() - started:.0f}"}
    print(*(f"{name}: {value}" for name, value in about.items()), sep="\n", end="\n\n")
    print(aligned([HEAD, *map(Cell.cells, cells)]), NOTES, sep="\n\n")
    if arguments.quick:
        print("--quick: a smoke test, whose numbers mean nothing.")
    if arguments.json is not None:
        results = {"machine": about, "quick": arguments.quick, "rows": [*map(vars, cells)]}
        arguments.json.write_text(json.dumps(results, indent=2) + "\n")
    if arguments.plot is not None:
        from benchmarks.scaling_plot import draw

        draw(cells, cells[-1].robots, arguments.plot)


def planned(arguments: argparse.Namespace, folder: Path) -> list[tuple]:
    """Arguments of :func:`~benchmarks.scaling_cells.measure_cell`: robots at one size of body, bodies at one number."""
    robots, hinges = (
        (ROBOTS[:2], HINGES[:2]) if arguments.quick else (arguments.robots, arguments.hinges)
    )
    sizes = [(count, USUAL) for count in robots]
    sizes += [(robots[-1] if arguments.quick else AT, count) for count in hinges]
    bodies = {count: write_body(folder, count) for _, count in sizes}
    threads = sorted({1, usable_cores()})
    return [(*size, cores, bodies[size[1]]) for size, cores in itertools.product(sizes, threads)]


def measured(arguments: tuple) -> Cell:
    """A line of the table, from a process of its own."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as process:
        return process.submit(measure_cell, *arguments).result()


if __name__ == "__main__":
    main()
