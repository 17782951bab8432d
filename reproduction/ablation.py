"""The report's figures and claims, from the runs of a sweep: ``python -m reproduction.ablation SWEEP``.

Writes ``curves.csv``, ``figure2.png``, ``figure3.png`` and ``summary.md`` into a folder. All but the
first come from ``curves.csv`` alone, so anyone can draw and count again what a day of computing gave:
``python -m reproduction.ablation reproduction/results/curves.csv``.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from locomotion.cli.refusal import refusing
from locomotion.plots import (
    REPORT,
    Curve,
    figure2,
    figure3,
    read_csv,
    read_sweep,
    save,
    write_csv,
)
from locomotion.runs import RunError
from locomotion.writing import atomic_write
from reproduction import RESULTS
from reproduction.claims import OBSERVATIONS, summary


def collect(sources: Sequence[Path]) -> list[Curve]:
    """The curves of the finished runs in the folders of sweeps, and those of CSV files.

    Runs that are not as long as the longest are left out, each with a line on standard error.

    Raises:
        RunError: if there is none, or they do not compare.
    """
    files = [source for source in sources if source.suffix == ".csv"]
    folders = [source for source in sources if source.suffix != ".csv"]
    curves = [curve for file in files for curve in read_csv(file)]
    curves += read_sweep(folders) if folders else []
    count = Counter(map(str, curves))
    twice = [name for name in count if count[name] > 1]
    if twice:
        raise RunError(f"{', '.join(map(str, sources))} hold {twice[0]} more than once")
    longest = max(len(curve.iteration) for curve in curves)
    for curve in curves:
        if len(curve.iteration) < longest:
            iterations = f"{len(curve.iteration)} of {longest} iterations"
            print(f"left out, as it is not finished: {curve}, {iterations}", file=sys.stderr)
    return sorted(
        (curve for curve in curves if len(curve.iteration) == longest),
        # In the order of the tables; other observations after those.
        key=lambda curve: (curve.robot != "gecko", curve.robot, _place(curve), curve.seed),
    )


def _place(curve: Curve) -> tuple[int, str]:
    known = curve.observations in OBSERVATIONS
    place = OBSERVATIONS.index(curve.observations) if known else len(OBSERVATIONS)
    return place, curve.observations


def write(curves: Sequence[Curve], folder: Path) -> str:
    """Leaves curves, figures and summary in a folder; returns the summary.

    Raises:
        RunError: if there are no runs for Figure 2.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_csv(folder / "curves.csv", curves)
    curves, report = read_csv(folder / "curves.csv"), read_csv(REPORT)
    save(figure2(curves, report), folder / "figure2.png")
    save(figure3(curves, report), folder / "figure3.png")
    iterations = len(curves[0].iteration)
    text = (
        "<!-- Written by python -m reproduction.ablation; what is changed here is lost. -->\n\n"
        f"{len(curves)} runs of {iterations} iterations.\n\n{summary(curves, report)}\n"
    )
    with atomic_write(folder / "summary.md") as partial:
        partial.write_text(text, encoding="utf-8")
    return text


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m reproduction.ablation", description=__doc__)
    parser.add_argument(
        "sources",
        nargs="+",
        type=Path,
        metavar="SWEEP",
        help="folders of sweeps, and any curves.csv that this command wrote",
    )
    parser.add_argument("--output", type=Path, default=RESULTS, metavar="FOLDER")
    arguments = parser.parse_args()
    with refusing():
        print(write(collect(arguments.sources), arguments.output))


if __name__ == "__main__":
    main()
