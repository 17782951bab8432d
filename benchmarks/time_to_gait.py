"""Measures the time until a robot walks: ``python -m benchmarks.time_to_gait``.

Learners of this project and of others learn the gait of the same compiled robot, each in a process of its
own, one after another and in turns. benchmarks/README.md says what is measured.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.arguments import Parser
from benchmarks.gait_sides import SIDES
from benchmarks.rows import load, machine, table

if TYPE_CHECKING:
    from benchmarks.gait_rows import Measured

DESCRIPTION = "Measures how long learners take, from the start of their process, to a gait."

#: One of each learner, all with our hyperparameters, so that what is compared is the implementation.
DEFAULT = tuple(side for side in SIDES if side.endswith(":quick"))

NOTES = """\
Time: from the start of the process, imports included, to the end of the iteration from which the mean
reward over 8,192 control steps stays above the value; inf: not within the time that a side has. A ratio
counts a side that never got there with that time. Bare MuJoCo: mujoco.batch on all cores, 1,000 robots,
100 control steps each under uniformly random targets."""


def main() -> None:
    """Measures what the command line asks for, and prints the table."""
    parser = _parser()
    arguments = parser.parse_args()
    for name in ("only", "robots"):  # none of them twice
        setattr(arguments, name, list(dict.fromkeys(getattr(arguments, name))))
    for name in ("seeds", "torch_threads"):
        if getattr(arguments, name) < 1:
            option = name.replace("_", "-")
            parser.error(f"--{option} {getattr(arguments, name)} must be at least 1")
    if not 0 < arguments.seconds < float("inf"):
        parser.error(f"--seconds {arguments.seconds} must be above 0, and finite")
    # Without a screen, dm-control warns in every process that imports it.
    os.environ.setdefault("MUJOCO_GL", "disabled")
    from benchmarks.gait_runs import SideFailed
    from locomotion.options import ConfigError
    from locomotion.quiet import quiet

    try:
        with quiet():
            measure(arguments)
    except ConfigError as error:
        parser.error(str(error))
    except SideFailed as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        kept = "" if arguments.json is None else f"; {arguments.json} has what was measured"
        print(f"stopped{kept}", file=sys.stderr)
        sys.exit(130)


def measure(arguments: argparse.Namespace) -> None:
    """Lets all sides learn, in turns, and prints what came of it."""
    from benchmarks.gait_check import largest_difference
    from benchmarks.gait_rows import Measured, rows
    from benchmarks.gait_runs import Limits, bare_seconds, prepare, run_side

    started = time.perf_counter()
    threads = str(arguments.torch_threads)
    about = {**machine(), "torch threads of others": threads, "load at the start": load()}
    found = Measured(arguments.seconds)
    copies, steps, iterations = (100, 10, 2) if arguments.quick else (1000, 100, None)
    limits = Limits(arguments.seconds, arguments.torch_threads, iterations)
    with tempfile.TemporaryDirectory(prefix="time_to_gait_") as folder:
        robots = [prepare(name, Path(folder)) for name in arguments.robots]
        found.apart = {robot.name: largest_difference(robot) for robot in robots}
        for seed, robot in itertools.product(range(arguments.seeds), robots):
            found.bare.setdefault(robot.name, []).append(bare_seconds(robot, copies, steps))
            # Who comes first changes from turn to turn.
            first = seed % len(arguments.only)
            for side in (*arguments.only[first:], *arguments.only[:first]):
                run = run_side(side, robot, seed, limits)
                found.runs.append(run)
                print(found.describe(run), file=sys.stderr, flush=True)
                about["seconds"] = f"{time.perf_counter() - started:.0f}"
                _write(arguments, about, found)
    about["load at the end"] = load()
    _write(arguments, about, found)
    print(*(f"{name}: {value}" for name, value in about.items()), sep="\n", end="\n\n")
    print(table(rows(found)), NOTES, sep="\n\n")
    if arguments.quick:
        print("--quick: a smoke test, whose numbers mean nothing.")


def _write(arguments: argparse.Namespace, about: dict[str, str], found: Measured) -> None:
    """Writes all that was found so far, so that an interruption loses nothing."""
    if arguments.json is None:
        return
    from benchmarks.gait_rows import rows

    results = {
        "machine": about,
        "quick": arguments.quick,
        "rows": [row.record() for row in rows(found)],
        **found.record(),
    }
    arguments.json.write_text(json.dumps(results, indent=1, allow_nan=False) + "\n")


def _parser() -> Parser:
    parser = Parser("benchmarks.time_to_gait", DESCRIPTION, "two iterations of each")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=SIDES,
        default=DEFAULT,
        metavar="SIDE",
        help=f"who learns: {', '.join(SIDES)} (default: {' '.join(DEFAULT)})",
    )
    parser.add_argument(
        "--all", action="store_const", const=SIDES, dest="only", help="all of these learn"
    )
    parser.add_argument("--robots", nargs="+", default=["gecko"], help="robots (default: gecko)")
    parser.add_argument("--seeds", type=int, default=1, help="turns, a seed each (default: 1)")
    parser.add_argument(
        "--seconds",
        type=float,
        default=90.0,
        help="most that a side has, its start included (default: 90)",
    )
    parser.add_argument(
        "--torch-threads",
        type=int,
        default=1,
        metavar="N",
        help="torch's threads in the others; ours has one (default: 1)",
    )
    return parser


if __name__ == "__main__":
    main()
