"""The report's figures: what is drawn where."""

import numpy as np
import pytest
from scipy import stats

from locomotion.plots import (
    REPORT,
    figure2,
    figure3,
    learning_curves,
    mean_interval,
    read_csv,
)
from locomotion.runs import RunError

OBSERVATIONS = ("history3", "hinges_orientation", "hinges", "history3_hinges")


@pytest.fixture(scope="module")
def sweep(curve):
    """Three seeds of each robot with each observation."""
    random = np.random.default_rng(1)
    return [
        curve(robot, name, seed, random.normal(size=20))
        for robot in ("gecko", "ant")
        for name in OBSERVATIONS
        for seed in range(3)
    ]


def test_figure_3_has_a_panel_a_robot_and_a_line_a_set_of_observations(sweep, lines):
    report = read_csv(REPORT)
    gecko, ant = figure3(sweep, report).axes
    assert (gecko.get_title(), ant.get_title()) == ("Gecko", "Ant")
    colours = dict(zip(OBSERVATIONS, ("#0072B2", "#D55E00", "#009E73", "#999999"), strict=True))
    for axes, robot in ((gecko, "gecko"), (ant, "ant")):
        for name, colour in colours.items():
            own = [c.mean_reward for c in sweep if (c.robot, c.observations) == (robot, name)]
            (mean,) = lines(axes, colour)
            np.testing.assert_allclose(mean, np.mean(own, axis=0))
            assert len(lines(axes, colour, width=0.5)) == 3  # every seed, thin
            known = [c.mean_reward for c in report if (c.robot, c.observations) == (robot, name)]
            assert len(known) == (0 if name == "history3_hinges" else 1)
            np.testing.assert_array_equal(lines(axes, colour, "--"), known)
    # The addition to the report is drawn lighter.
    widths = [
        max(line.get_linewidth() for line in gecko.lines if line.get_color() == colour)
        for colour in (colours["history3_hinges"], colours["history3"])
    ]
    assert widths[0] < widths[1]
    assert gecko.get_ylim() == ant.get_ylim()


def test_figure_2_has_reward_and_value_and_the_reports_value_on_its_own_axis(sweep, lines, curve):
    report = read_csv(REPORT)
    reward, value, scaled = figure2(sweep, report).axes
    assert scaled.get_ylim() == (0, 1)
    for robot, colour in (("gecko", "#0072B2"), ("ant", "#D55E00")):
        setting = (robot, "hinges_orientation")
        own = [c for c in sweep if (c.robot, c.observations) == setting]
        (known,) = (c for c in report if (c.robot, c.observations) == setting)
        for axes, column in ((reward, "mean_reward"), (value, "mean_value")):
            mean = np.mean([getattr(c, column) for c in own], axis=0)
            np.testing.assert_allclose(lines(axes, colour), [mean])
        np.testing.assert_array_equal(lines(reward, colour, "--"), [known.mean_reward])
        np.testing.assert_array_equal(lines(scaled, colour, "--"), [known.mean_value])
        assert not lines(value, colour, "--")
    assert len(figure2(sweep).axes) == 2
    with pytest.raises(RunError, match=r"needs runs with \+obs=hinges_orientation"):
        figure2([curve()])


def test_the_band_is_the_confidence_interval_of_the_mean(curve):
    rewards = np.random.default_rng(2).normal(size=(4, 6))
    curves = [curve(seed=seed, rewards=row) for seed, row in enumerate(rewards)]
    (axes,) = figure3(curves).axes
    (band,) = axes.collections
    expected = stats.ttest_1samp(rewards, 0).confidence_interval(0.95)
    (outline,) = (path.vertices for path in band.get_paths())
    for iteration in range(6):
        edge = outline[outline[:, 0] == iteration, 1]
        np.testing.assert_allclose(edge.min(), expected.low[iteration])
        np.testing.assert_allclose(edge.max(), expected.high[iteration])
    assert not figure3(curves[:1]).axes[0].collections


def test_runs_of_different_lengths_have_a_mean_of_those_that_came_so_far(curve, lines):
    curves = [curve(rewards=[1, 2, 3]), curve(seed=1, rewards=[3, 4]), curve(seed=2, rewards=[5])]
    ((mean,),) = (lines(axes, "#009E73") for axes in figure3(curves).axes)
    np.testing.assert_allclose(mean, [3, 3, 3])
    values = np.array([[1.0, 2, 3], [3, 4, np.nan], [5, np.nan, np.nan]])
    _, low, high = mean_interval(values)
    expected = stats.ttest_1samp(values[:2, 1], 0).confidence_interval(0.95)
    np.testing.assert_allclose((low[1], high[1]), expected)
    assert np.isnan([low[2], high[2]]).all()


def test_values_may_be_unknown(curve):
    unknown = [np.nan, np.nan]
    curves = [
        curve(observations="hinges_orientation", seed=seed, values=unknown) for seed in (0, 1)
    ]
    reward, value = figure2(curves).axes
    assert len(reward.lines) == len(value.lines) == 3
    assert np.isfinite(value.get_ylim()).all()


def test_any_number_of_runs_is_told_apart(curve):
    metrics = np.array(
        [(0, 0.1, 1.0), (1, 0.2, 2.0)],
        dtype=[("iteration", float), ("mean_reward", float), ("mean_value", float)],
    )
    figure = learning_curves({str(run): metrics for run in range(20)}, [curve(seed=None)])
    left, right = figure.axes
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        *map(str, range(20)),
        "report: gecko, hinges",
    ]
    looks = {(line.get_color(), line.get_linestyle()) for line in right.lines}
    assert len(looks) == len(right.lines) == 20
    assert len(left.lines) == 21
    assert not learning_curves({"alone": metrics}).legends
