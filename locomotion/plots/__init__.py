"""Reading the learning curves of runs, and drawing them."""

from locomotion.plots.curves import REPORT, Curve, read_csv, read_run, read_sweep, write_csv
from locomotion.plots.figures import (
    figure2,
    figure3,
    learning_curves,
    plot_learning_curves,
    save,
)
from locomotion.plots.statistics import align, mean_interval

__all__ = [
    "REPORT",
    "Curve",
    "align",
    "figure2",
    "figure3",
    "learning_curves",
    "mean_interval",
    "plot_learning_curves",
    "read_csv",
    "read_run",
    "read_sweep",
    "save",
    "write_csv",
]
