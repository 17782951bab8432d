"""The figures: any runs side by side, and the report's two."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from locomotion.plots.curves import Curve, read_metrics
from locomotion.plots.observations import observations_label
from locomotion.plots.statistics import align, mean_interval
from locomotion.runs import RunError
from locomotion.writing import atomic_write

ROBOTS = ("gecko", "ant")
FIGURE2_OBSERVATIONS = "hinges_orientation"
REWARD = "average reward per action (m)"
VALUE = "average state value (m)"

# Okabe and Ito's colours, which the colour-blind tell apart.
_BLUE, _RED, _GREEN, _GREY = "#0072B2", "#D55E00", "#009E73", "#999999"
_MORE = ("#CC79A7", "#E69F00", "#56B4E9", "#000000")
_ROBOT_COLOURS = {"gecko": _BLUE, "ant": _RED}
_OBSERVATIONS_COLOURS = {
    "history3": _BLUE,
    "hinges_orientation": _RED,
    "hinges": _GREEN,
    "history3_hinges": _GREY,
}
#: What the report's Figure 3 shows; anything else is an addition and drawn lighter.
_FIGURE3_OBSERVATIONS = ("history3", "hinges_orientation", "hinges")


def learning_curves(runs: Mapping[str, np.ndarray], reference: Sequence[Curve] = ()) -> Figure:
    """Reward and value of any runs over the iterations.

    Args:
        runs: metrics of each run by its label.
        reference: curves to draw dashed with their rewards.
    """
    entries = len(runs) + len(reference)
    rows = -(-entries // 2) if entries > 1 else 0
    figure = Figure(figsize=(10, 4 + 0.18 * rows), layout="constrained")
    left, right = figure.subplots(1, 2)
    styles = itertools.product(("-", "-.", ":"), (_BLUE, _RED, _GREEN, *_MORE))
    for (label, metrics), (style, colour) in zip(
        runs.items(), itertools.cycle(styles), strict=False
    ):
        for axes, column in ((left, "mean_reward"), (right, "mean_value")):
            axes.plot(metrics["iteration"], metrics[column], style, color=colour, label=label)
    dashes = itertools.cycle([(5, 2), (2, 1), (6, 1, 1, 1), (1, 1)])
    for curve, dash in zip(reference, dashes, strict=False):
        label = f"{_name(reference)}: {curve.robot}, {curve.observations}"
        left.plot(curve.iteration, curve.mean_reward, color="0.5", dashes=dash, label=label)
    _finish(left, REWARD)
    _finish(right, VALUE)
    if rows:
        handles = left.get_legend_handles_labels()
        figure.legend(
            *handles, loc="outside lower center", ncols=2, fontsize="small", frameon=False
        )
    return figure


def figure2(curves: Sequence[Curve], reference: Sequence[Curve] = ()) -> Figure:
    """The report's Figure 2: reward and value of the robots that sense hinges and orientation.

    Args:
        curves: those of a sweep; other observations are left out.
        reference: drawn dashed. The report's values are scaled to [0, 1], so they have an axis of
            their own.

    Raises:
        RunError: if no curve is of these observations.
    """
    shown = [curve for curve in curves if curve.observations == FIGURE2_OBSERVATIONS]
    if not shown:
        raise RunError(f"Figure 2 needs runs with +obs={FIGURE2_OBSERVATIONS}, and there are none")
    known = [curve for curve in reference if curve.observations == FIGURE2_OBSERVATIONS]
    robots = _in_order({curve.robot for curve in (*shown, *known)}, ROBOTS)
    colours = _colours(robots, _ROBOT_COLOURS)
    figure = Figure(figsize=(10, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    scaled = right.twinx() if any(curve.seed is None for curve in known) else None
    for robot in robots:
        own = [curve for curve in shown if curve.robot == robot]
        _draw(left, own, "mean_reward", colours[robot])
        _draw(right, own, "mean_value", colours[robot])
        for curve in known:
            if curve.robot == robot:
                axes = scaled if curve.seed is None else right
                _draw_reference(left, curve, "mean_reward", colours[robot])
                _draw_reference(axes, curve, "mean_value", colours[robot])
    _finish(left, REWARD, "Average reward")
    _finish(right, VALUE, "Average state value")
    if scaled is not None:
        scaled.set(ylabel="report's value, targets scaled to [0, 1]", ylim=(0, 1))
        scaled.spines["top"].set_visible(False)
    _legend(figure, {robot.capitalize(): colours[robot] for robot in robots}, (), shown, known)
    return figure


def figure3(curves: Sequence[Curve], reference: Sequence[Curve] = ()) -> Figure:
    """The report's Figure 3: reward of each robot, one panel a robot, one line a set of observations.

    Args:
        curves: those of a sweep. Observations that the report has not are drawn lighter.
        reference: drawn dashed.
    """
    both = (*curves, *reference)
    robots = _in_order({curve.robot for curve in both}, ROBOTS)
    sets = _in_order({curve.observations for curve in both}, tuple(_OBSERVATIONS_COLOURS))
    colours = _colours(sets, _OBSERVATIONS_COLOURS)
    extra = [name for name in sets if name not in _FIGURE3_OBSERVATIONS]
    figure = Figure(figsize=(5 * len(robots), 4.6), layout="constrained")
    panels = figure.subplots(1, len(robots), squeeze=False)[0]
    for robot, panel in zip(robots, panels, strict=True):
        for name in reversed(sets):  # the first ones on top
            setting = (robot, name)
            own = [curve for curve in curves if (curve.robot, curve.observations) == setting]
            _draw(panel, own, "mean_reward", colours[name], lighter=name in extra)
            for curve in reference:
                if (curve.robot, curve.observations) == setting:
                    _draw_reference(panel, curve, "mean_reward", colours[name])
        _finish(panel, REWARD if panel is panels[0] else "", robot.capitalize())
    limits = np.array([panel.get_ylim() for panel in panels])
    for panel in panels:
        panel.set_ylim(limits[:, 0].min(), limits[:, 1].max())
    entries = {observations_label(name): colours[name] for name in sets}
    _legend(figure, entries, [observations_label(name) for name in extra], curves, reference)
    return figure


def save(figure: Figure, target: Path) -> None:
    """Writes a figure whole; the ending of the name chooses the format.

    Raises:
        RunError: if the file cannot be written.
    """
    formats = figure.canvas.get_supported_filetypes()
    if target.suffix[1:] not in formats:
        raise RunError(
            f"{target}: not the ending of a picture; choose from {', '.join(sorted(formats))}"
        )
    for text in figure.findobj(Text):
        text.set_parse_math(False)  # names of folders may have dollars
    try:
        with atomic_write(target) as partial, warnings.catch_warnings():
            # Of alphabets that the font has not; the others can be read.
            warnings.filterwarnings("ignore", "Glyph .* missing from font")
            figure.savefig(partial, dpi=120)
    except OSError as error:
        raise RunError(f"{target}: {error.strerror}") from error


def plot_learning_curves(run: Path, target: Path) -> None:
    """Draws the learning curve of one run into a picture.

    Raises:
        RunError: if the folder is not a run's.
    """
    save(learning_curves({str(run): read_metrics(run)}), target)


def _draw(
    axes: Axes, curves: Sequence[Curve], column: str, colour: str, lighter: bool = False
) -> None:
    """Some seeds, thin, their mean, and around it the 95% confidence interval of the mean."""
    if not curves:
        return
    iterations, values = align(curves, column)
    mean, low, high = mean_interval(values)
    if len(curves) > 1:
        axes.plot(iterations, values.T, color=colour, linewidth=0.5, alpha=0.45)
        opacity = 0.08 if lighter else 0.16
        axes.fill_between(iterations, low, high, color=colour, alpha=opacity, linewidth=0)
    axes.plot(iterations, mean, color=colour, linewidth=1.2 if lighter else 1.9)


def _draw_reference(axes: Axes, curve: Curve, column: str, colour: str) -> None:
    values = getattr(curve, column)
    axes.plot(curve.iteration, values, "--", color=colour, linewidth=1.1, alpha=0.8)


def _name(reference: Sequence[Curve]) -> str:
    return "report" if all(curve.seed is None for curve in reference) else "reference"


def _finish(axes: Axes, ylabel: str, title: str = "") -> None:
    # Lines set the scale, not bands: the interval of three seeds is far wider than they are apart.
    drawn = np.concatenate([line.get_ydata() for line in axes.lines])
    drawn = drawn[np.isfinite(drawn)]
    low, high = (drawn.min(), drawn.max()) if len(drawn) else (0.0, 1.0)
    margin = 0.08 * (high - low) or 0.01
    axes.set(xlabel="iteration", ylabel=ylabel, title=title, ylim=(low - margin, high + margin))
    axes.margins(x=0.01)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)


def _legend(
    figure: Figure,
    entries: Mapping[str, str],
    extra: Sequence[str],
    curves: Sequence[Curve],
    reference: Sequence[Curve],
) -> None:
    """Below the panels, where it hides nothing: colours first, then what the styles mean."""
    handles = [
        Line2D([], [], color=colour, linewidth=1.2 if label in extra else 1.9, label=label)
        for label, colour in entries.items()
    ]
    handles.append(Line2D([], [], color="0.3", linewidth=1.9, label=_seeds(curves)))
    if reference:
        handles.append(
            Line2D([], [], color="0.3", linewidth=1.1, linestyle="--", label=_name(reference))
        )
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=4 if len(handles) <= 4 else 3,
        fontsize="small",
        frameon=False,
    )


def _seeds(curves: Sequence[Curve]) -> str:
    counts: dict[tuple[str, str], int] = {}
    for curve in curves:
        setting = (curve.robot, curve.observations)
        counts[setting] = counts.get(setting, 0) + 1
    fewest, most = min(counts.values()), max(counts.values())
    if most == 1:
        return "one seed each"
    seeds = str(most) if fewest == most else f"{fewest} to {most}"
    return f"mean of {seeds} seeds (thin) and its 95% interval"


def _in_order(names: set[str], first: Sequence[str]) -> list[str]:
    return [*(name for name in first if name in names), *sorted(names - set(first))]


def _colours(names: Sequence[str], known: Mapping[str, str]) -> dict[str, str]:
    more = [name for name in names if name not in known]
    return {**known, **{name: _MORE[i % len(_MORE)] for i, name in enumerate(more)}}
