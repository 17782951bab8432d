"""The mean over seeds, and how far it can be trusted."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from scipy import special  # scipy.stats takes a second to import, at the end of every run

from locomotion.plots.curves import Curve


def align(curves: Sequence[Curve], column: str) -> tuple[np.ndarray, np.ndarray]:
    """Some curves over the same iterations, all that any of them has.

    Args:
        curves: such as those of one robot and observations, one a seed.
        column: ``"mean_reward"`` or ``"mean_value"``.

    Returns:
        iterations, shape ``(iterations,)``; values, shape ``(curves, iterations)``, nan where a run
        has not come so far.
    """
    iterations = functools.reduce(np.union1d, [curve.iteration for curve in curves])
    values = np.full((len(curves), len(iterations)), np.nan)
    for row, curve in zip(values, curves, strict=True):
        row[np.searchsorted(iterations, curve.iteration)] = getattr(curve, column)
    return iterations, values


def mean_interval(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The mean over seeds and its 95% confidence interval, by Student's t.

    Student's t, as a bootstrap of three seeds has ten different samples and comes out far too narrow.

    Args:
        values: shape ``(seeds, ...)``; nan is left out.

    Returns:
        mean, lower and upper bound, each of shape ``(...)``; the bounds are nan with one seed.
    """
    values = np.asarray(values, float)
    seeds = (~np.isnan(values)).sum(0)
    mean = np.nansum(values, 0) / np.maximum(seeds, 1)
    mean = np.where(seeds > 0, mean, np.nan)
    freedom = np.where(seeds > 1, seeds - 1.0, np.nan)
    variance = np.nansum((values - mean) ** 2, 0) / freedom
    half = special.stdtrit(freedom, 0.975) * np.sqrt(variance / np.maximum(seeds, 1))
    return mean, mean - half, mean + half
