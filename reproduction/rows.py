"""Rows of results: dataclasses in CSV files, measured from runs or read again."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from locomotion.plots.curves import find_runs
from locomotion.writing import atomic_write

T = TypeVar("T")
_TYPES = {"str": str, "int": int, "float": float}


def read(kind: type[T], path: Path) -> list[T]:
    """The rows that :func:`write` left, of strings, integers and floats."""
    types = {field.name: _TYPES[field.type] for field in dataclasses.fields(kind)}
    with path.open(encoding="utf-8", newline="") as file:
        return [
            kind(**{name: types[name](value) for name, value in line.items()})
            for line in csv.DictReader(file)
        ]


def write(path: Path, rows: Sequence[T]) -> None:
    """Leaves rows in a CSV file, floats with four digits."""
    with atomic_write(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in dataclasses.fields(rows[0])])
        writer.writeheader()
        for row in rows:
            shown = {k: f"{v:.4f}" if isinstance(v, float) else v for k, v in vars(row).items()}
            writer.writerow(shown)


def gather(
    kind: type[T],
    sources: Iterable[Path],
    measure: Callable[[Sequence[Path]], Iterable[T]],
    output: Path,
) -> list[T]:
    """Rows of CSV files and of runs; those of runs, with the others, are left in a file.

    Args:
        kind: the rows' dataclass.
        sources: CSV files, and folders with runs below them.
        measure: gets all runs, and gives their rows.
        output: where to.
    """
    files = [source for source in sources if source.suffix == ".csv"]
    folders = [source for source in sources if source.suffix != ".csv"]
    rows = [row for file in files for row in read(kind, file)]
    if folders:
        rows += measure(find_runs(folders))
        write(output, rows)
    return rows
