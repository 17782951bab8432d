"""Effect of a history of hinge positions under other settings than the report's.

``python -m reproduction.history SWEEP ...`` takes folders of sweeps, each named by what is different in it,
with runs of ``hinges_orientation`` and ``history3``, or of the latter alone where the former would be as
with the report's settings. It keeps their curves as ``history/NAME.csv`` in ``reproduction/results``, and
writes ``history.md`` there from all that are kept and from ``curves.csv``. Without a folder it writes that
again.
"""

from __future__ import annotations

import argparse
import dataclasses
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from locomotion.cli.refusal import refusing
from locomotion.plots import Curve, read_csv, write_csv
from locomotion.writing import atomic_write
from reproduction import RESULTS
from reproduction.ablation import collect
from reproduction.claims import ABOVE_4, ABOVE_8, FINAL, WHOLE, show_p, table, welch

WITHOUT, WITH = "hinges_orientation", "history3"
HEADS = {
    "What three positions change": ("one position", "three positions"),
    "What the setting changes": ("as in the report", "with the setting"),
}


def kept(curves: Iterable[Curve]) -> list[Curve]:
    """Curves as they are kept: three positions that are scaled are a history too."""
    return [
        dataclasses.replace(curve, observations=WITH)
        if re.fullmatch(r"3 steps x \S+ \+ orientation", curve.observations)
        else curve
        for curve in curves
    ]


def history_changes(
    setting: str, curves: Sequence[Curve], usual: Sequence[Curve]
) -> list[list[str]]:
    """Three positions against one, a row for each robot and measure."""
    rows = []
    for robot in dict.fromkeys(curve.robot for curve in curves):
        without = _chosen(curves, robot, WITHOUT) or _chosen(usual, robot, WITHOUT)
        with_ = _chosen(curves, robot, WITH)
        if with_:
            rows += _rows([setting, robot], without, with_)
    return rows


def setting_changes(
    setting: str, curves: Sequence[Curve], usual: Sequence[Curve]
) -> list[list[str]]:
    """A setting against the report's, a row for each robot, observations and measure."""
    rows = []
    for robot, name in dict.fromkeys((curve.robot, curve.observations) for curve in curves):
        groups = [_chosen(some, robot, name) for some in (usual, curves)]
        rows += _rows([f"{setting}, {name}", robot], *groups)
    return rows


def _chosen(curves: Sequence[Curve], robot: str, observations: str) -> list[Curve]:
    return [curve for curve in curves if (curve.robot, curve.observations) == (robot, observations)]


def _rows(start: list[str], before: Sequence[Curve], after: Sequence[Curve]) -> list[list[str]]:
    seeds = " and ".join(dict.fromkeys(str(len(group)) for group in (before, after)))
    rows = []
    for measure in (FINAL, WHOLE, ABOVE_4, ABOVE_8):
        values = [measure.over(group) for group in (before, after)]
        shown = [measure.show(value) for value in values]
        p, low, high = welch(values[1], values[0])
        difference = ""
        if not np.isnan(p):
            changed = values[1].mean() - values[0].mean()
            difference = measure.interval(changed, low, high, sign="+")
        rows.append([*start, seeds, measure.name, *shown, difference, show_p(p)])
    return rows


def compare(settings: Mapping[str, Sequence[Curve]], usual: Sequence[Curve]) -> str:
    """Both tables in Markdown.

    Args:
        settings: the curves of each setting, by its name.
        usual: those of the report's settings.
    """
    history, setting = history_changes("as in the report", usual, usual), []
    for name, curves in settings.items():
        history += history_changes(name, curves, usual)
        setting += setting_changes(name, curves, usual)
    lines = ["<!-- Written by python -m reproduction.history. -->"]
    for (title, groups), rows in zip(HEADS.items(), (history, setting)):
        head = ["setting", "robot", "seeds", "measure", *groups, "difference", "p"]
        lines += ["", f"## {title}", "", *table(head, rows)]
    return "\n".join([*lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m reproduction.history", description=__doc__)
    parser.add_argument("sweeps", nargs="*", type=Path, metavar="SWEEP")
    parser.add_argument("--output", type=Path, default=RESULTS, metavar="FOLDER")
    arguments = parser.parse_args()
    folder = arguments.output / "history"
    with refusing():
        folder.mkdir(parents=True, exist_ok=True)
        for sweep in arguments.sweeps:
            write_csv(folder / f"{sweep.resolve().name}.csv", kept(collect([sweep])))
        settings = {file.stem: read_csv(file) for file in sorted(folder.glob("*.csv"))}
        text = compare(settings, read_csv(RESULTS / "curves.csv"))
        with atomic_write(arguments.output / "history.md") as partial:
            partial.write_text(text, encoding="utf-8")
    print(text, end="")


if __name__ == "__main__":
    main()
