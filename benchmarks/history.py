"""Whether a history of hinge positions helps under other settings than the report's.

``python -m benchmarks.history SWEEP ...`` takes folders of sweeps, each named by what is different in it,
with runs of ``hinges_orientation`` and ``history3``. It keeps their curves as ``history/NAME.csv`` below
``benchmarks/results``, and writes ``history.md`` from all that are there beside ``curves.csv``. Without a
folder it writes that again.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy import stats

from benchmarks.ablation import collect
from benchmarks.claims import ABOVE_4, FINAL, WHOLE, Measure
from locomotion.plots import Curve, read_csv, write_csv
from locomotion.runs import RunError
from locomotion.writing import replacing

RESULTS = Path(__file__).with_name("results")
WITHOUT, WITH = "hinges_orientation", "history3"
HEAD = [
    "setting",
    "robot",
    "seeds",
    "measure",
    "one position",
    "three positions",
    "difference",
    "p",
]


def compare(setting: str, curves: Sequence[Curve]) -> list[list[str]]:
    """What three positions change against one, a row for each robot and measure."""
    rows = []
    for robot in dict.fromkeys(curve.robot for curve in curves):
        groups = [
            [curve for curve in curves if (curve.robot, curve.observations) == (robot, name)]
            for name in (WITHOUT, WITH)
        ]
        seeds = " and ".join(dict.fromkeys(str(len(group)) for group in groups))
        for measure in (FINAL, WHOLE, ABOVE_4):
            values = [measure.over(group) for group in groups]
            shown = [measure.show(value) for value in values]
            rows.append(
                [setting, robot, seeds, measure.name, *shown, *_difference(measure, *values)]
            )
    return rows


def _difference(measure: Measure, without: np.ndarray, with_: np.ndarray) -> tuple[str, str]:
    """By Welch's t, with its 95% interval, and the two-sided p."""
    if min(len(without), len(with_)) < 2 or not np.isfinite([*without, *with_]).all():
        return "", ""
    test = stats.ttest_ind(with_, without, equal_var=False)
    low, high = test.confidence_interval(0.95)
    shown = measure.interval(with_.mean() - without.mean(), low, high, sign="+")
    return shown, f"{test.pvalue:.3f}"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.history", description=__doc__)
    parser.add_argument("sweeps", nargs="*", type=Path, metavar="SWEEP")
    folder = RESULTS / "history"
    try:
        for sweep in parser.parse_args().sweeps:
            folder.mkdir(exist_ok=True)
            write_csv(folder / f"{sweep.resolve().name}.csv", collect([sweep]))
        rows = compare("as in the report", read_csv(RESULTS / "curves.csv"))
        for file in sorted(folder.glob("*.csv")):
            rows += compare(file.stem, read_csv(file))
    except (RunError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    lines = [f"| {' | '.join(cells)} |" for cells in (HEAD, ["---"] * len(HEAD), *rows)]
    text = "\n".join(["<!-- Written by python -m benchmarks.history. -->", "", *lines, ""])
    with replacing(RESULTS / "history.md") as partial:
        partial.write_text(text)
    print(text, end="")


if __name__ == "__main__":
    main()
