"""Rows of one table, and the machine that they come from."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import os
import platform
import statistics
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Any

PACKAGES = (
    "torch",
    "torchrl",
    "tensordict",
    "mujoco",
    "mujoco-warp",
    "warp-lang",
    "dm-control",
    "gymnasium",
    "stable-baselines3",
    "rsl-rl-lib",
)


@dataclasses.dataclass
class Row:
    """A line of the table.

    Attributes:
        name: what is measured, with its unit unless it is a ratio.
        values: one a turn, the median counts; empty if it could not be measured.
        target: what the median should reach; ``None`` for context.
        at_most: whether the target is the most that is allowed rather than the least.
        form: how a value is printed.
        context: absolute numbers behind it, or why there are no values.
    """

    name: str
    values: list[float]
    target: float | None = None
    at_most: bool = False
    form: str = "{:.3f}"
    context: str = ""

    @property
    def median(self) -> float | None:
        return statistics.median(self.values) if self.values else None

    @property
    def met(self) -> bool | None:
        if self.target is None or self.median is None:
            return None
        return self.median <= self.target if self.at_most else self.median >= self.target

    def cells(self) -> tuple[str, ...]:
        """The row as text, in the order of the table's columns."""
        show = self.form.format
        bound = "at most " if self.at_most else "at least "
        return (
            self.name,
            "-" if self.median is None else show(self.median),
            f"{show(min(self.values))} to {show(max(self.values))}" if self.values[1:] else "",
            "" if self.target is None else bound + show(self.target),
            {True: "yes", False: "NO", None: ""}[self.met],
            self.context,
        )

    def record(self) -> dict[str, Any]:
        """The row as JSON has it, which knows no infinity: ``None`` stands for it."""
        values = [*self.values, self.median]
        *values, median = (value if value is None or isfinite(value) else None for value in values)
        return {**dataclasses.asdict(self), "values": values, "median": median, "met": self.met}


def table(rows: Sequence[Row]) -> str:
    """All rows below each other, under a line of headings."""
    heads = ("", "median", "min to max", "target", "met", "context (medians)")
    return aligned([heads, *(row.cells() for row in rows)])


def aligned(lines: Sequence[Sequence[str]]) -> str:
    """Lines of as many cells, in columns; the first line has the headings."""
    widths = [max(len(cell) for cell in column) for column in zip(*lines, strict=True)]
    texts = [
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    ]
    return "\n".join([texts[0], "-" * len(texts[0]), *texts[1:]])


def machine() -> dict[str, str]:
    """Versions, cores, and the model of the CPU."""
    return {
        "python": platform.python_version(),
        **{package: _version(package) for package in PACKAGES},
        "cores": str(usable_cores()),
        "CPU": _cpu_model(),
    }


def load() -> str:
    """The number of processes that wanted a core in the last minute, this one included."""
    return f"{os.getloadavg()[0]:.1f}"


def usable_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def _cpu_model() -> str:
    path = Path("/proc/cpuinfo")
    for line in path.read_text().splitlines() if path.is_file() else ():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
