"""Learning curves, read from the folders of runs and from CSV files."""

import numpy as np
import pytest

from locomotion import plot
from locomotion.plots import REPORT, figure3, read_csv, read_run, read_sweep, write_csv
from locomotion.plots.observations import observations_label, observations_name
from locomotion.runs import RunError


def test_runs_are_known_by_their_configuration(tmp_path, make_run):
    make_run(tmp_path / "b", "robot=ant", "+obs=history3", "seed=4")
    overrides = ["obs.hinge_position.steps=5", "obs.core_orientation.representation=gravity"]
    make_run(tmp_path / "a" / "deep", *overrides, rewards=[0.5])
    with (tmp_path / "b" / "metrics.csv").open("a") as file:
        file.write("2,192,0.")  # this row is still being written
    make_run(tmp_path / "c", "seed=5", rewards=[])
    first, second = read_sweep([tmp_path, tmp_path / "b"])
    assert str(first) == "gecko, 5 steps + gravity, seed 0"
    assert str(second) == "ant, history3, seed 4"
    np.testing.assert_allclose(second.mean_reward, [0, 0.1])
    np.testing.assert_allclose(second.mean_value, [0, 8])
    assert figure3([first, second], read_csv(REPORT)).axes[1].get_title() == "Ant"


@pytest.mark.parametrize(
    ("terms", "name"),
    [
        ({"hinge_position": None}, "hinges"),
        ({"hinge_position": {"steps": 3}, "core_orientation": {}}, "history3"),
        (
            {"core_orientation": {"representation": "quaternion"}, "hinge_position": {"steps": 1}},
            "hinges_orientation",
        ),
        ({"hinge_position": {}, "core_orientation": {"representation": "yaw"}}, "1 step + yaw"),
        ({"hinge_position": {"scale": 0.5}}, "1 step x 0.5"),
        (
            {"hinge_position": {"steps": 2}, "hinge_velocity": {"scale": 0.1}, "core_height": {}},
            "2 steps + hinge velocity x 0.1 + core height",
        ),
        # What is read counts, not what the term is called.
        ({"sight": {"reading": "core_height", "steps": 2}}, "2 steps core height"),
        ({"sight": {"reading": "phase_clock", "steps": 2}}, "2 steps phase clock"),
        ({"upright": {"reading": "core_orientation", "representation": "gravity"}}, "gravity"),
        # A reading that only some package of somebody else's has.
        ({"my_sense": {"steps": 2}}, "2 steps my sense"),
    ],
)
def test_observations_have_the_name_of_a_choice_or_a_description(terms, name):
    assert observations_name(terms) == name


def test_a_legend_says_what_a_name_means():
    assert observations_label("history3") == "history3: 3 steps + orientation"
    assert observations_label("5 steps + gravity") == "5 steps + gravity"


def test_a_figure_needs_runs_that_compare(tmp_path, make_run):
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


def test_runs_of_one_configuration_are_told_apart_by_their_folders(tmp_path, make_run):
    for name in ("a", "b"):
        make_run(tmp_path / name)
    name = "gecko, hinges_orientation, seed 0"
    assert plot.labels([tmp_path / "a", tmp_path / "b"]) == [
        f"{name} ({tmp_path / 'a'})",
        f"{name} ({tmp_path / 'b'})",
    ]


@pytest.mark.parametrize(
    ("metrics", "message"),
    [
        (None, "holds no metrics.csv, so it is not a run's folder"),
        ("", "has no row yet"),
        ("iteration,mean_reward,mean_value\n0,0.1,8", "has no row yet"),
        ("iteration,mean_reward\n0,0.1\n", "has no column mean_value"),
        ("iteration,mean_reward,mean_value\n0,0.1,8\n1,0.2\n", "has rows of different lengths"),
        ("iteration,mean_reward,mean_value\n0,much,8\n", "has a mean_reward that is not a number"),
    ],
)
def test_metrics_that_cannot_be_read_are_named(tmp_path, make_run, metrics, message):
    make_run(tmp_path)
    (tmp_path / "metrics.csv").unlink()
    if metrics is not None:
        (tmp_path / "metrics.csv").write_text(metrics)
    with pytest.raises(RunError, match=message):
        read_run(tmp_path)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (None, "holds no .hydra/config.yaml"),
        ("seed: 3\n", "has no robot"),
        ("robot: gecko\n", "is not of this project"),
        ("robot: {name: gecko}\nseed: 0\nobs: {hinge_position: 3}\n", "is not of this project"),
        (
            "robot: {name: gecko}\nseed: 0\nobs: {hinge_position: {depth: 3}}\n",
            "depth is not a key",
        ),
    ],
)
def test_a_folder_of_another_project_is_named(tmp_path, make_run, config, message):
    make_run(tmp_path)
    path = tmp_path / ".hydra" / "config.yaml"
    path.unlink() if config is None else path.write_text(config)
    with pytest.raises(RunError, match=message):
        read_run(tmp_path)


def test_curves_survive_a_csv_file(tmp_path, curve):
    curves = [
        curve(seed=3, rewards=[0.123456, -1e-7]),
        curve("ant", "5 steps + gravity", 4, [1, 2, 3], [np.nan, 1, 2]),
    ]
    write_csv(tmp_path / "curves.csv", curves)
    for read, written in zip(read_csv(tmp_path / "curves.csv"), curves, strict=True):
        assert str(read) == str(written)
        for column in ("iteration", "mean_reward", "mean_value"):
            np.testing.assert_allclose(getattr(read, column), getattr(written, column), rtol=1e-5)


@pytest.mark.parametrize(
    ("setting", "at", "last_ten"),
    [
        (("gecko", "history3"), (0.048, 0.081, 0.086, 0.087, 0.088), 0.0870),
        (("gecko", "hinges_orientation"), (0.017, 0.044, 0.072, 0.082, 0.090), 0.0919),
        (("gecko", "hinges"), (0.006, 0.010, 0.005, 0.009, 0.012), 0.0047),
        (("ant", "history3"), (0.004, 0.022, 0.066, 0.079, 0.083), 0.0831),
        (("ant", "hinges_orientation"), (0.004, 0.005, 0.017, 0.049, 0.081), 0.0824),
        (("ant", "hinges"), (0.001, 0.001, 0.002, 0.001, 0.005), 0.0016),
    ],
)
def test_the_reports_numbers(setting, at, last_ten):
    (known,) = (c for c in read_csv(REPORT) if (c.robot, c.observations) == setting)
    np.testing.assert_allclose(known.mean_reward[[25, 50, 75, 100, 150]], at, atol=0.0006)
    assert known.mean_reward[-10:].mean() == pytest.approx(last_ten, abs=0.00016)
