"""Learning curves: ``python -m locomotion.plot RUN ...``, or ``figure2 SWEEP`` and ``figure3 SWEEP``.

Reads the ``metrics.csv`` of runs, also while they train, and says what they are from their own
configuration, so folders can have any names.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from locomotion.cli.refusal import refusing
from locomotion.config import free_keys
from locomotion.plots.curves import (
    REPORT,
    Curve,
    find_runs,
    has_rows,
    read_csv,
    read_metrics,
    read_run,
    read_sweep,
)
from locomotion.plots.figures import figure2, figure3, learning_curves, save
from locomotion.runs import RunError, read_record

FIGURES = {"figure2": figure2, "figure3": figure3}


def compare(places: Sequence[Path], reference: Sequence[Curve]) -> Figure:
    """The curves of any runs, with the reference's for the same robots and observations.

    Raises:
        RunError: if there is none, or none has a row yet.
    """
    found = find_runs(places)
    runs = [run for run in found if has_rows(run)] or found
    metrics = {label: read_metrics(run) for label, run in zip(labels(runs), runs, strict=True)}
    settings = set()
    if reference:
        curves = map(read_run, runs)
        settings = {(curve.robot, curve.observations) for curve in curves}
    known = [curve for curve in reference if (curve.robot, curve.observations) in settings]
    return learning_curves(metrics, known)


def labels(runs: Sequence[Path]) -> list[str]:
    """Labels that tell runs apart: robot, observations, seed, and other keys where they differ.

    A run that has no configuration, or is not told apart by it, has its folder.
    """
    records = []
    for run in runs:
        try:
            records.append((str(read_run(run)), read_record(run)))
        except RunError:
            records.append((str(run), {}))
    told, free = ("seed", "robot.", "obs."), free_keys()
    keys = dict.fromkeys(key for _, record in records for key in record)
    differing = [
        key
        for key in keys
        if key not in free
        and not key.startswith(told)
        and len({str(record.get(key)) for _, record in records if record}) > 1
    ]
    found = [
        ", ".join([name, *(f"{key}={record[key]}" for key in differing if key in record)])
        for name, record in records
    ]
    count = Counter(found)
    return [
        name if count[name] == 1 or name == str(run) else f"{name} ({run})"
        for name, run in zip(found, runs, strict=True)
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m locomotion.plot",
        usage="%(prog)s [figure2 | figure3] FOLDER ... [--reference [FILE] | --no-reference] "
        "[--output PICTURE]",
        description="Draws the learning curves of runs side by side, or those of a sweep as one of"
        " the report's figures: mean and 95% confidence interval over seeds.",
    )
    parser.add_argument(
        "what", nargs="+", metavar="FOLDER", help="a run, or a folder with runs anywhere below it"
    )
    parser.add_argument(
        "--reference",
        nargs="?",
        type=Path,
        const=REPORT,
        metavar="FILE",
        help="dashed: the report's curves, or those of a CSV file; figures have the report's",
    )
    parser.add_argument(
        "--no-reference", action="store_true", help="leaves the report's curves out of its figures"
    )
    parser.add_argument("--output", type=Path, metavar="PICTURE")
    with refusing():
        arguments = parser.parse_args()
        name, *folders = arguments.what
        draw = FIGURES.get(name)
        if draw is None:
            folders, name = arguments.what, "learning_curves"
        elif not folders:
            raise RunError(f"{name} of what? Give the folder of a sweep: {name} sweeps/ablation")
        path = arguments.reference or (REPORT if draw is not None else None)
        reference = [] if path is None or arguments.no_reference else read_csv(path)
        places = [Path(folder) for folder in folders]
        if draw is None:
            figure = compare(places, reference)
        else:
            figure = draw(read_sweep(places), reference)
        target = arguments.output or Path(f"{name}.png")
        save(figure, target)
        print(target)


if __name__ == "__main__":
    main()
