"""Learning curves: ``python -m locomotion.plot RUN [RUN ...]``.

Reads the ``metrics.csv`` of runs, also while they go on.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from locomotion.runs import RunError


def read_metrics(run: Path) -> np.ndarray:
    """The rows of a run's ``metrics.csv``, as a structured array with the columns' names.

    Raises:
        RunError: if there is none, or it has no row yet.
    """
    path = run / "metrics.csv"
    if not path.is_file():
        raise RunError(f"{run} holds no metrics.csv, so it is no run's folder")
    with path.open() as lines:
        complete = [line for line in lines if line.endswith("\n")]
    if len(complete) < 2:
        raise RunError(f"{path} has no row yet")
    return np.atleast_1d(np.genfromtxt(complete, delimiter=",", names=True))


def plot_learning_curves(runs: Sequence[Path], target: Path) -> None:
    """Draws mean reward and mean value over the iterations of some runs into one picture.

    Args:
        runs: the runs' folders.
        target: picture to write; its ending chooses the format.

    Raises:
        RunError: if a folder is no run.
    """
    curves = [(str(run), read_metrics(run)) for run in runs]
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for name, curve in curves:
        axes[0].plot(curve["iteration"], curve["mean_reward"], label=name)
        axes[1].plot(curve["iteration"], curve["mean_value"], label=name)
    axes[0].set(xlabel="iteration", ylabel="mean reward per action (m)")
    axes[1].set(xlabel="iteration", ylabel="mean value (m)")
    for axis in axes:
        axis.grid(alpha=0.3)
    if len(runs) > 1:
        axes[0].legend(fontsize="small")
    figure.savefig(target, dpi=120)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m locomotion.plot", description="Draws the learning curves of runs."
    )
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="folder of a run")
    parser.add_argument("--output", type=Path, default=Path("learning_curves.png"))
    arguments = parser.parse_args()
    try:
        plot_learning_curves(arguments.runs, arguments.output)
    except RunError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    print(arguments.output)


if __name__ == "__main__":
    main()
