"""Costs and savings of the framework: ``python -m benchmarks.throughput``.

Results are ratios of two sides that take turns within one run, so that a noisy machine is noisy to
both: the median of the ratios of neighbouring turns, with the smallest and the largest. Only the
parts of a control step, memory, and how far two simulations come apart are absolute.
"""

from __future__ import annotations

import argparse
import json
import os
import time

from benchmarks.arguments import Parser
from benchmarks.rows import load, machine, table

# Processes that are started import this module again, so what is heavy is imported where it is used:
# nobody's memory shall hold what they do not need.

DESCRIPTION = "Measures what the framework costs and what it saves, as ratios in one table."

#: Those of benchmarks/sections.py.
SECTIONS = ("limit", "parts", "rivals", "step", "update", "scale")

NOTES = """\
Sides of a ratio take turns. Collector: environment, transforms, policy and storage, as in training, by
TorchRL's Collector. Bare MuJoCo: the faster of mujoco.rollout and mujoco.batch, which replay each batch.
Rivals: one process a robot, stepping the same compiled model; they are driven by precomputed random
actions without a policy and store nothing, which is kinder to them. Memory: peak of the proportional
set size, summed over all processes; training collects and learns, rivals only step."""


def main() -> None:
    """Measures what the command line asks for, and prints the table."""
    parser = Parser("benchmarks.throughput", DESCRIPTION, "few turns and robots")
    parser.add_argument(
        "--only", nargs="+", choices=SECTIONS, default=SECTIONS, help="what to measure"
    )
    arguments = parser.parse_args()
    # Without a screen, dm-control warns in every process that imports it.
    os.environ.setdefault("MUJOCO_GL", "disabled")
    from locomotion.quiet import quiet

    with quiet():
        measure(arguments)


def measure(arguments: argparse.Namespace) -> None:
    """Measures what was asked for, and prints the table."""
    from benchmarks import sections

    started = time.perf_counter()
    about = {**machine(), "load at the start": load()}
    effort = sections.QUICK if arguments.quick else sections.FULL
    rows = [row for name in arguments.only for row in sections.SECTIONS[name](effort)]
    about |= {"load at the end": load(), "seconds": f"{time.perf_counter() - started:.0f}"}
    print(*(f"{name}: {value}" for name, value in about.items()), sep="\n", end="\n\n")
    print(table(rows), NOTES, sep="\n\n")
    if arguments.quick:
        print("--quick: a smoke test, whose numbers mean nothing.")
    if arguments.json is not None:
        results = {
            "machine": about,
            "quick": arguments.quick,
            "rows": [row.record() for row in rows],
        }
        arguments.json.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
