"""Curves, the report's figures, and the numbers that its claims are held against."""

import subprocess
import sys

import matplotlib.colors
import numpy as np
import pytest
from omegaconf import OmegaConf
from scipy import stats

from benchmarks import ablation, claims
from locomotion import plot
from locomotion.command_line.composing import compose
from locomotion.plots import REPORT, Curve, figure2, figure3, mean_interval, read_csv, read_sweep
from locomotion.runs import RunError, record

OBSERVATIONS = ("history3", "hinges_orientation", "hinges", "history3_hinges")


def curve(robot="gecko", observations="hinges", seed=0, rewards=(0.0, 0.1), values=None):
    rewards = np.array(rewards)
    values = 80 * rewards if values is None else np.array(values)
    return Curve(robot, observations, seed, np.arange(len(rewards)), rewards, values)


def sweep(seeds=3, iterations=20):
    random = np.random.default_rng(1)
    return [
        curve(robot, name, seed, random.normal(size=iterations))
        for robot in ("gecko", "ant")
        for name in OBSERVATIONS
        for seed in range(seeds)
    ]


def make_run(folder, *overrides, rewards=(0.0, 0.1)):
    """Leaves a run's configuration and metrics in a folder."""
    record(folder, config=OmegaConf.structured(compose(*overrides)))
    rows = [f"{i},{(i + 1) * 64},{reward},{80 * reward}\n" for i, reward in enumerate(rewards)]
    (folder / "metrics.csv").write_text(
        "".join(["iteration,frames,mean_reward,mean_value\n", *rows])
    )


def lines(axes, colour, style="-", width=None):
    """The curves of a colour, thick ones only unless a width is given."""
    return [
        line.get_ydata()
        for line in axes.lines
        if matplotlib.colors.same_color(line.get_color(), colour)
        and line.get_linestyle() == style
        and (line.get_linewidth() > 1 if width is None else line.get_linewidth() == width)
    ]


def run(monkeypatch, main, *arguments):
    monkeypatch.setattr(sys, "argv", ["plot", *map(str, arguments)])
    main()


def test_figure_3_has_a_panel_a_robot_and_a_line_a_set_of_observations():
    curves, report = sweep(), read_csv(REPORT)
    gecko, ant = figure3(curves, report).axes
    assert (gecko.get_title(), ant.get_title()) == ("Gecko", "Ant")
    colours = dict(zip(OBSERVATIONS, ("#0072B2", "#D55E00", "#009E73", "#999999"), strict=True))
    for axes, robot in ((gecko, "gecko"), (ant, "ant")):
        for name, colour in colours.items():
            own = [c.mean_reward for c in curves if (c.robot, c.observations) == (robot, name)]
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


def test_figure_2_has_reward_and_value_and_the_reports_value_on_its_own_axis():
    curves, report = sweep(), read_csv(REPORT)
    reward, value, scaled = figure2(curves, report).axes
    assert scaled.get_ylim() == (0, 1)
    for robot, colour in (("gecko", "#0072B2"), ("ant", "#D55E00")):
        setting = (robot, "hinges_orientation")
        own = [c for c in curves if (c.robot, c.observations) == setting]
        (known,) = (c for c in report if (c.robot, c.observations) == setting)
        np.testing.assert_allclose(
            lines(reward, colour), [np.mean([c.mean_reward for c in own], axis=0)]
        )
        np.testing.assert_allclose(
            lines(value, colour), [np.mean([c.mean_value for c in own], axis=0)]
        )
        np.testing.assert_array_equal(lines(reward, colour, "--"), [known.mean_reward])
        np.testing.assert_array_equal(lines(scaled, colour, "--"), [known.mean_value])
        assert not lines(value, colour, "--")
    assert len(figure2(curves).axes) == 2
    with pytest.raises(RunError, match=r"needs runs with \+obs=hinges_orientation"):
        figure2([curve()])


def test_the_band_is_the_confidence_interval_of_the_mean():
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


def test_runs_of_different_lengths_have_a_mean_of_those_that_came_so_far():
    curves = [curve(rewards=[1, 2, 3]), curve(seed=1, rewards=[3, 4]), curve(seed=2, rewards=[5])]
    ((mean,),) = (lines(axes, "#009E73") for axes in figure3(curves).axes)
    np.testing.assert_allclose(mean, [3, 3, 3])
    values = np.array([[1.0, 2, 3], [3, 4, np.nan], [5, np.nan, np.nan]])
    _, low, high = mean_interval(values)
    expected = stats.ttest_1samp(values[:2, 1], 0).confidence_interval(0.95)
    np.testing.assert_allclose((low[1], high[1]), expected)
    assert np.isnan([low[2], high[2]]).all()


def test_runs_are_known_by_their_configuration(tmp_path):
    make_run(tmp_path / "b", "robot=ant", "+obs=history3", "seed=4")
    make_run(tmp_path / "a" / "deep", "obs.hinge_steps=5", "obs.orientation=gravity", rewards=[0.5])
    with (tmp_path / "b" / "metrics.csv").open("a") as file:
        file.write("2,192,0.")  # this row is still being written
    make_run(tmp_path / "c", "seed=5", rewards=[])
    first, second = read_sweep([tmp_path, tmp_path / "b"])
    assert str(first) == "gecko, 5 steps + gravity, seed 0"
    assert str(second) == "ant, history3, seed 4"
    np.testing.assert_allclose(second.mean_reward, [0, 0.1])
    assert figure3([first, second], read_csv(REPORT)).axes[1].get_title() == "Ant"


def test_a_figure_needs_runs_that_compare(tmp_path):
    make_run(tmp_path / "a")
    make_run(tmp_path / "b", "robot=ant", "seed=1", "physics.threads=2")
    assert len(read_sweep([tmp_path])) == 2
    make_run(tmp_path / "c", "physics.threads=1")
    with pytest.raises(RunError, match="a and .*c are both gecko, hinges_orientation, seed 0"):
        read_sweep([tmp_path])
    make_run(tmp_path / "c", "seed=2", "ppo.gamma=0.9")
    with pytest.raises(RunError, match=r"a has ppo.gamma=0.99 and .*c 0.9: no figure for both"):
        read_sweep([tmp_path])
    labels = plot.labels([tmp_path / "a", tmp_path / "c"])
    assert labels == [
        "gecko, hinges_orientation, seed 0, ppo.gamma=0.99",
        "gecko, hinges_orientation, seed 2, ppo.gamma=0.9",
    ]


@pytest.mark.parametrize(
    ("setting", "at", "last_ten", "above_8"),
    [
        (("gecko", "history3"), (0.048, 0.081, 0.086, 0.087, 0.088), 0.0870, 49),
        (("gecko", "hinges_orientation"), (0.017, 0.044, 0.072, 0.082, 0.090), 0.0919, 92),
        (("gecko", "hinges"), (0.006, 0.010, 0.005, 0.009, 0.012), 0.0047, np.inf),
        (("ant", "history3"), (0.004, 0.022, 0.066, 0.079, 0.083), 0.0831, 108),
        (("ant", "hinges_orientation"), (0.004, 0.005, 0.017, 0.049, 0.081), 0.0824, 143),
        (("ant", "hinges"), (0.001, 0.001, 0.002, 0.001, 0.005), 0.0016, np.inf),
    ],
)
def test_the_reports_numbers(setting, at, last_ten, above_8):
    (known,) = (c for c in read_csv(REPORT) if (c.robot, c.observations) == setting)
    np.testing.assert_allclose(known.mean_reward[[25, 50, 75, 100, 150]], at, atol=0.0006)
    assert round(claims.final_reward(known), 4) == pytest.approx(last_ten, abs=0.00011)
    assert claims.ABOVE_8.of(known) == above_8


def test_numbers_over_seeds_equal_those_counted_by_hand():
    finals = np.array([0.10, 0.12, 0.14])
    # s = 0.02, so the half interval is 4.3027 * 0.02 / sqrt(3).
    assert claims.FINAL.show(finals) == "0.1200 [0.0703, 0.1697]"
    assert claims.FINAL.show(finals[:1]) == "0.1000"
    assert claims.ABOVE_4.show(np.array([10, 20, 30.0])) == "20 [-5, 45]"
    assert claims.ABOVE_4.show(np.array([10, 20, np.inf])) == "never in 1 of 3, median 20"
    assert claims.ABOVE_4.show(np.array([10, np.inf, np.inf])) == "never in 2 of 3"
    steps = curve(rewards=[0.0] * 5 + [0.04, 0.05] + [0.1] * 11)
    assert claims.ABOVE_4.of(steps) == 6
    assert claims.FINAL.of(steps) == pytest.approx(0.1)
    assert claims.WHOLE.of(steps) == pytest.approx((0.04 + 0.05 + 1.1) / 18)


def test_claims_are_shown_reversed_or_open():
    def runs(observations, *finals):
        return [
            curve(observations=observations, seed=seed, rewards=[final] * 12)
            for seed, final in enumerate(finals)
        ]

    curves = [*runs("hinges_orientation", 0.10, 0.11, 0.12), *runs("hinges", 0.01, 0.02, 0.03)]
    text = claims.summary([*curves, *runs("history3", 0.05, 0.06, 0.07)], read_csv(REPORT))
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines()]
    found = {(row[0], row[1]): row[2:] for row in rows if len(row) == 6}
    # s = 0.01 in both, 4 degrees of freedom: 0.09 +- 2.7764 * 0.01 * sqrt(2 / 3).
    key = ("gecko: hinges_orientation minus hinges", claims.FINAL.name)
    assert found[key] == ["+0.0900 [+0.0673, +0.1127]", "<0.001", "+0.0871", "yes"]
    key = ("gecko: history3 minus hinges_orientation", claims.WHOLE.name)
    assert found[key][3] == "no, the reverse"
    assert found["gecko: hinges, below 0.04", claims.FINAL.name][3] == "open"
    assert found["ant: hinges, below 0.04", claims.FINAL.name] == ["-", "", "0.0016", "-"]
    assert found["gecko: history3 minus hinges_orientation", claims.ABOVE_8.name] == [
        "never in 3 of 3 and 0 [0, 0]",
        "",
        "-43",
        "-",
    ]


def test_results_can_be_drawn_again_from_their_curves(tmp_path, monkeypatch, capsys):
    for seed, rewards in enumerate([(0.1, 0.2), (0.3, 0.4), (0.5,)]):
        make_run(tmp_path / str(seed), f"seed={seed}", rewards=rewards)
    run(monkeypatch, ablation.main, tmp_path, "--output", tmp_path / "one")
    printed = capsys.readouterr()
    assert "gecko | hinges_orientation | 2 | 0.2500 [-1.0206, 1.5206] | 0.0919" in printed.out
    assert printed.err.count("\n") == 1
    assert "gecko, hinges_orientation, seed 2, 1 of 2 iterations" in printed.err
    run(monkeypatch, ablation.main, tmp_path / "one" / "curves.csv", "--output", tmp_path / "two")
    for name in ("curves.csv", "summary.md", "figure2.png", "figure3.png"):
        content = (tmp_path / "one" / name).read_bytes()
        assert content and content == (tmp_path / "two" / name).read_bytes()


def test_the_command_draws_a_sweep_beside_the_report(tmp_path, monkeypatch, capsys):
    make_run(tmp_path / "run")
    (tmp_path / "mine.csv").write_text(
        "robot,observations,iteration,mean_reward,mean_value\ngecko,hinges,0,0.5,\n"
    )
    monkeypatch.chdir(tmp_path)
    for arguments in (
        ("figure2", "run"),
        ("figure3", "run", "--reference", "mine.csv", "--output", "figure3.svg"),
        ("run", "--reference"),
    ):
        run(monkeypatch, plot.main, *arguments)
    assert capsys.readouterr().out == "figure2.png\nfigure3.svg\nlearning_curves.png\n"
    assert "report" in (tmp_path / "figure3.svg").read_text()
    assert sorted(path.name for path in tmp_path.glob("*.??g")) == [
        "figure2.png",
        "figure3.svg",
        "learning_curves.png",
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "nowhere holds no metrics.csv, so it is no run's folder"),
        (["figure3", "."], "no run in . has a row yet"),
        (["figure2"], "figure2 of what? Give the folder of a sweep: figure2 sweeps/ablation"),
        (["figure2", ".", "--reference", "no.csv"], "no.csv: No such file or directory"),
        (["figure2", ".", "--reference", "bad.csv"], "bad.csv has no column mean_reward"),
        (["figure2", ".", "--reference", "torn.csv"], "torn.csv, line 2: could not convert"),
        (["run"], "run/metrics.csv has no row yet"),
    ],
)
def test_a_wrong_call_ends_in_one_line(arguments, message, tmp_path, monkeypatch, capsys):
    make_run(tmp_path / "run", rewards=[])
    (tmp_path / "bad.csv").write_text("robot,observations,iteration\ngecko,hinges,0\n")
    (tmp_path / "torn.csv").write_text(
        "robot,observations,iteration,mean_reward,mean_value\ngecko,hinges,0,much,1\n"
    )
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        run(monkeypatch, plot.main, *arguments)
    printed = capsys.readouterr()
    assert ended.value.code == 2
    assert printed.err.startswith(f"error: {message}")
    assert printed.err.count("\n") == 1


def test_a_picture_that_cannot_be_written_is_named(tmp_path):
    make_run(tmp_path / "run")
    for output, message in (
        ("curves.jpgg", "error: curves.jpgg: no picture's ending; choose from"),
        ("no/curves.png", "error: no/curves.png: No such file or directory"),
    ):
        command = [sys.executable, "-m", "locomotion.plot", "run", "--output", output]
        result = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
        assert result.returncode == 2
        assert result.stderr.startswith(message)
        assert result.stderr.count("\n") == 1
        assert [path.name for path in tmp_path.iterdir()] == ["run"]
