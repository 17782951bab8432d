"""The report's claims, judged by runs: numbers over seeds, as Markdown tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from scipy import stats

from locomotion.plots import Curve, mean_interval

ROBOTS = ("gecko", "ant")
#: In the order of the table; the last is ours.
OBSERVATIONS = ("history3", "hinges_orientation", "hinges", "history3_hinges")
LAST = 10
NOTHING = "-"

Setting = tuple[str, str]


@dataclasses.dataclass(frozen=True)
class Measure:
    """A number that sums up a run.

    Attributes:
        name: what it is, with its unit.
        of: its value for a curve; infinite for what the run never reached.
        digits: printed after the point.
    """

    name: str
    of: Callable[[Curve], float]
    digits: int

    def over(self, curves: Iterable[Curve]) -> np.ndarray:
        """Its value for each of some curves, shape ``(curves,)``."""
        return np.array([self.of(curve) for curve in curves])

    def show(self, values: np.ndarray) -> str:
        """Mean and 95% interval. Where runs never got there, how many, and the median of all."""
        never = int(np.isinf(values).sum())
        if len(values) == 0:
            return NOTHING
        if never == 0:
            return self.interval(*mean_interval(values))
        if len(values) == 1:
            return "never"
        median = float(np.median(values))
        count = f"never in {never} of {len(values)}"
        return count if np.isinf(median) else f"{count}, median {median:.{self.digits}f}"

    def interval(self, middle: float, low: float, high: float, sign: str = "") -> str:
        """A number and its interval, which is left out if it is nan."""
        middle, low, high = (f"{number:{sign}.{self.digits}f}" for number in (middle, low, high))
        return middle if "nan" in low else f"{middle} [{low}, {high}]"


def final_reward(curve: Curve) -> float:
    """Mean reward per action (m) of the last ten iterations."""
    return float(curve.mean_reward[-LAST:].mean())


def whole_reward(curve: Curve) -> float:
    """Mean reward per action (m) of the whole run: the area under its curve, by iteration."""
    return float(curve.mean_reward.mean())


def first_above(threshold: float) -> Callable[[Curve], float]:
    """The first iteration whose mean reward is above a threshold (m); infinite if there is none."""
    return lambda curve: _first(curve, curve.mean_reward > threshold)


def reward_after_value(curve: Curve) -> float:
    """Iterations from the value's first 90% of its peak to the reward's."""
    columns = (curve.mean_reward, curve.mean_value)
    reward, value = (_first(curve, column >= 0.9 * column.max()) for column in columns)
    return reward - value


def _first(curve: Curve, where: np.ndarray) -> float:
    return float(curve.iteration[where.argmax()]) if where.any() else np.inf


FINAL = Measure(f"reward of the last {LAST} iterations (m)", final_reward, 4)
WHOLE = Measure("mean reward of the whole run (m)", whole_reward, 4)
ABOVE_4 = Measure("first iteration above 0.04 m", first_above(0.04), 0)
ABOVE_8 = Measure("first iteration above 0.08 m", first_above(0.08), 0)
VALUE = Measure("iterations from value to reward, each at 90% of its peak", reward_after_value, 0)


_NUMBERS = """\
Mean over seeds and its 95% confidence interval by Student's t; the report does not say how many runs its
curves are. Where a seed never gets above a threshold there is no mean: it says how many never did, and
the median if it is a number."""

_CLAIMS = """\
*Shown* says whether the whole 95% interval lies on the side of the claim, by Student's t for a level and
Welch's for a difference; p is two-sided and not corrected for the number of rows. *Open*: these seeds
cannot tell."""


def summary(curves: Sequence[Curve], report: Sequence[Curve]) -> str:
    """The numbers of some finished runs, the report's, and each claim with what it rests on."""
    ours, theirs = _by_setting(curves), _by_setting(report)
    return "\n".join(
        [
            "## Reward and speed",
            "",
            *_numbers(ours, theirs),
            "",
            _NUMBERS,
            "",
            "## The report's claims",
            "",
            _CLAIMS,
            *_claims(ours, theirs),
        ]
    )


def _by_setting(curves: Sequence[Curve]) -> dict[Setting, list[Curve]]:
    settings: dict[Setting, list[Curve]] = {}
    for curve in curves:
        settings.setdefault((curve.robot, curve.observations), []).append(curve)
    return settings


Runs = Mapping[Setting, Sequence[Curve]]


def _numbers(ours: Runs, theirs: Runs) -> list[str]:
    rows = []
    expected = [(robot, name) for robot in ROBOTS for name in OBSERVATIONS]
    for setting in [*expected, *sorted(ours.keys() - set(expected))]:
        curves, known = ours.get(setting, []), theirs.get(setting, [])
        row = [*setting, str(len(curves))]
        for measure in (FINAL, ABOVE_4, ABOVE_8):
            row += [measure.show(measure.over(curves)), measure.show(measure.over(known))]
        rows.append(row)
    heads = ["robot", "observations", "seeds"]
    for measure in (FINAL, ABOVE_4, ABOVE_8):
        heads += [measure.name, "report"]
    return table(heads, rows)


def _claims(ours: Runs, theirs: Runs) -> list[str]:
    """A heading and a table for each claim."""
    judge = _Judge(ours, theirs)
    both = [("gecko", "hinges_orientation"), ("ant", "hinges_orientation")]
    claims = {
        "Both robots reach a reward slightly above 0.08 m": [
            judge.level(*setting, FINAL, 0.08, more=True) for setting in both
        ],
        "The Ant requires many more iterations to learn": [
            judge.difference(both[1], both[0], measure, more=True) for measure in (ABOVE_4, ABOVE_8)
        ],
        "The Gecko reaches higher rewards": [judge.difference(*both, FINAL, more=True)],
        "Value peaks around the same time as reward": [
            judge.level(*setting, VALUE) for setting in both
        ],
        "The last three positions of the hinges speed learning up": [
            judge.difference((robot, "history3"), (robot, "hinges_orientation"), measure, more)
            for robot in ROBOTS
            for measure, more in ((ABOVE_4, False), (ABOVE_8, False), (WHOLE, True), (FINAL, None))
        ],
        "Without orientation neither robot can walk": judge.needs_orientation(
            "hinges_orientation", "hinges"
        ),
        "Not in the report: nor does history make up for orientation": judge.needs_orientation(
            "history3", "history3_hinges"
        ),
    }
    heads = ["runs", "measure", "mean over seeds [95% interval]", "p", "report", "shown"]
    return [
        line
        for claim, rows in claims.items()
        for line in ("", f"### {claim}", "", *table(heads, rows))
    ]


@dataclasses.dataclass(frozen=True)
class _Judge:
    """Rows of claims; ``more`` is the side that a claim is on, if any."""

    ours: Runs
    theirs: Runs

    def level(
        self, robot: str, name: str, measure: Measure, bound: float = 0.0, more: bool | None = None
    ) -> list[str]:
        """Whether runs are above or below a bound."""
        setting = (robot, name)
        values = measure.over(self.ours.get(setting, []))
        p, low, high = np.nan, np.nan, np.nan
        if len(values) > 1 and np.isfinite(values).all():
            test = stats.ttest_1samp(values, bound)
            p, (low, high) = test.pvalue, test.confidence_interval(0.95)
        against = "" if more is None else f", {'above' if more else 'below'} {bound:g}"
        return [
            f"{robot}: {name}{against}",
            measure.name,
            measure.show(values),
            "" if more is None else show_p(p),
            measure.show(measure.over(self.theirs.get(setting, []))),
            _shown(low - bound, high - bound, more),
        ]

    def difference(
        self, one: Setting, other: Setting, measure: Measure, more: bool | None = None
    ) -> list[str]:
        """Whether runs of one setting are above or below those of another."""
        a, b = (measure.over(self.ours.get(setting, [])) for setting in (one, other))
        p, low, high = welch(a, b)
        known = (measure.over(self.theirs.get(setting, [])) for setting in (one, other))
        if one[0] == other[0]:
            subject = f"{one[0]}: {one[1]} minus {other[1]}"
        else:
            subject = f"{one[1]}: {one[0]} minus {other[0]}"
        return [
            subject,
            measure.name,
            _difference(measure, a, b, low, high),
            show_p(p),
            _difference(measure, *known, np.nan, np.nan),
            _shown(low, high, more),
        ]

    def needs_orientation(self, sensed: str, without: str) -> list[list[str]]:
        """Whether robots do better with orientation, and do not walk without."""
        return [
            row
            for robot in ROBOTS
            for row in (
                self.difference((robot, sensed), (robot, without), FINAL, more=True),
                self.level(robot, without, FINAL, 0.04, more=False),
            )
        ]


def welch(a: np.ndarray, b: np.ndarray) -> tuple[float, float, float]:
    """Welch's t test of two groups of runs: two-sided p, and the 95% interval of the means' difference.

    All nan where a group has fewer than two runs, or one that never reached what is measured.
    """
    if min(len(a), len(b)) < 2 or not np.isfinite([*a, *b]).all():
        return np.nan, np.nan, np.nan
    test = stats.ttest_ind(a, b, equal_var=False)
    return test.pvalue, *test.confidence_interval(0.95)


def _difference(measure: Measure, a: np.ndarray, b: np.ndarray, low: float, high: float) -> str:
    if not len(a) or not len(b):
        return NOTHING
    if np.isinf([*a, *b]).any():
        return f"{measure.show(a)} and {measure.show(b)}"
    return measure.interval(a.mean() - b.mean(), low, high, sign="+")


def _shown(low: float, high: float, more: bool | None) -> str:
    if more is None:
        return ""
    if np.isnan(low):
        return NOTHING
    if low <= 0 <= high:
        return "open"
    return "yes" if (low > 0) == more else "no, the reverse"


def show_p(p: float) -> str:
    """A p value; nothing for nan."""
    if np.isnan(p):
        return ""
    return "<0.001" if p < 0.001 else f"{p:.3f}"


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """The lines of a Markdown table."""
    return [f"| {' | '.join(cells)} |" for cells in (heads, ["---"] * len(heads), *rows)]
