"""Learning curves: read from the folders of runs, and from and to CSV files."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from locomotion.config import free_keys
from locomotion.options import ConfigError
from locomotion.plots.observations import observations_name
from locomotion.runs import RunError, read_config, read_record
from locomotion.writing import atomic_write

#: The report's curves, read off its pictures (see ``README.md`` next to the file).
REPORT = Path(__file__).resolve().parents[1] / "data" / "report.csv"

COLUMNS = ("iteration", "mean_reward", "mean_value")


@dataclasses.dataclass(frozen=True)
class Curve:
    """The course of one run, or of the report's.

    Attributes:
        robot: its name.
        observations: their name, as :func:`observations_name` gives it.
        seed: ``None`` for the report, which does not say how many runs are behind a curve.
        iteration: shape ``(iterations,)``.
        mean_reward: shape ``(iterations,)``, metres per action.
        mean_value: shape ``(iterations,)``, discounted metres; nan where it is not known.
    """

    robot: str
    observations: str
    seed: int | None
    iteration: np.ndarray
    mean_reward: np.ndarray
    mean_value: np.ndarray

    def __str__(self) -> str:
        return f"{self.robot}, {self.observations}, seed {self.seed}"


def find_runs(places: Sequence[Path]) -> list[Path]:
    """The runs in some places, each itself a run or a folder with runs anywhere below it.

    What holds no run is left out if something else does: a pattern such as ``SWEEP/*`` also matches
    what Hydra and its launchers write next to runs.

    Raises:
        RunError: if none holds a run, or one is not there.
    """
    found = {
        place: [place]
        if (place / "metrics.csv").is_file()
        else sorted(path.parent for path in place.rglob("metrics.csv"))
        for place in places
    }
    for place in places:
        if not place.exists() or not any(found.values()):
            what = "is a file" if place.is_file() else "holds no metrics.csv"
            raise RunError(f"{place} {what}, so it is not a run's folder")
    return list({run.resolve(): run for runs in found.values() for run in runs}.values())


def has_rows(run: Path) -> bool:
    """Whether a run has come as far as one iteration."""
    return (run / "metrics.csv").read_bytes().count(b"\n") > 1


def read_metrics(run: Path) -> np.ndarray:
    """The rows of a run's ``metrics.csv``, as a structured array with the columns' names.

    Raises:
        RunError: if there is none, it has no row yet, or is another file.
    """
    path = run / "metrics.csv"
    if not path.is_file():
        raise RunError(f"{run} holds no metrics.csv, so it is not a run's folder")
    with path.open(encoding="utf-8", errors="replace") as lines:
        complete = [line for line in lines if line.endswith("\n")]
    if len(complete) < 2:
        raise RunError(f"{path} has no row yet")
    try:
        metrics = np.atleast_1d(np.genfromtxt(complete, delimiter=",", names=True))
    except ValueError:
        raise RunError(f"{path} has rows of different lengths") from None
    for column in COLUMNS:
        if column not in metrics.dtype.names:
            raise RunError(f"{path} has no column {column}")
        unknown = np.isnan(metrics[column]) & (column == "mean_value")  # not every learner has one
        if not (np.isfinite(metrics[column]) | unknown).all():
            raise RunError(f"{path} has a {column} that is not a number")
    return metrics


def read_run(run: Path) -> Curve:
    """The curve of a run, named by the run's own configuration.

    Raises:
        RunError: if the folder is not a run's, or the run has no row yet.
    """
    record = read_config(run)
    try:
        robot, seed = record["robot"]["name"], record["seed"]
        observations = observations_name(record["obs"])
    except KeyError as error:
        raise RunError(f"{run}/.hydra/config.yaml has no {error.args[0]}") from None
    except (AttributeError, TypeError, ConfigError) as error:
        raise RunError(f"{run}/.hydra/config.yaml is not of this project: {error}") from None
    metrics = read_metrics(run)
    return Curve(robot, observations, seed, *(metrics[column] for column in COLUMNS))


def read_sweep(places: Sequence[Path]) -> list[Curve]:
    """The curves of all runs in some folders, but for those that have no row yet.

    Raises:
        RunError: if there is none, two are of the same seed, or two differ in more than robot,
            observations and seed, so that they do not compare.
    """
    curves: dict[str, Curve] = {}
    origins: dict[str, Path] = {}
    free = free_keys()
    settings: dict[tuple[str, str], tuple[Path, object]] = {}
    for run in find_runs(places):
        if not has_rows(run):
            continue
        curve = read_run(run)
        if str(curve) in curves:
            raise RunError(f"{origins[str(curve)]} and {run} are both {curve}")
        curves[str(curve)], origins[str(curve)] = curve, run
        for key, value in read_record(run).items():
            if key == "seed" or key.startswith("obs.") or key in free:
                continue
            owner = curve.robot if key.startswith("robot.") else ""  # each robot has its own body
            first, known = settings.setdefault((owner, key), (run, value))
            if value != known:
                raise RunError(f"{first} has {key}={known} and {run} {value}: no figure for both")
    if not curves:
        raise RunError(f"no run in {', '.join(map(str, places))} has a row yet")
    return list(curves.values())


def read_csv(path: Path) -> list[Curve]:
    """The curves of a file with columns robot, observations, iteration, mean_reward and mean_value.

    A column seed may be missing, and a mean value empty.

    Raises:
        RunError: if the file is missing or has other columns.
    """
    rows: dict[tuple[str, str, int | None], list[list[float]]] = {}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            for row in reader:
                seed = int(row["seed"]) if "seed" in row else None
                numbers = [float(row[column] or "nan") for column in COLUMNS]
                rows.setdefault((row["robot"], row["observations"], seed), []).append(numbers)
    except OSError as error:
        raise RunError(f"{path}: {error.strerror}") from error
    except KeyError as error:
        raise RunError(f"{path} has no column {error.args[0]}") from None
    except (TypeError, ValueError, csv.Error) as error:
        raise RunError(f"{path}, line {reader.line_num}: {error}") from None
    if not rows:
        raise RunError(f"{path} holds no curve")
    return [Curve(*identity, *np.array(numbers).T) for identity, numbers in rows.items()]


def write_csv(path: Path, curves: Sequence[Curve]) -> None:
    """Writes the curves of runs into a file that :func:`read_csv` reads, one row an iteration."""
    with atomic_write(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("robot", "observations", "seed", *COLUMNS))
        for curve in curves:
            rows = zip(curve.iteration, curve.mean_reward, curve.mean_value, strict=True)
            for iteration, reward, value in rows:
                numbers = (f"{iteration:.0f}", f"{reward:.6g}", f"{value:.6g}")
                writer.writerow((curve.robot, curve.observations, curve.seed, *numbers))
