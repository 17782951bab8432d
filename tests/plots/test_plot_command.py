"""``python -m locomotion.plot``: which pictures it draws, and what it refuses."""

import sys

import pytest

from locomotion import plot

pytestmark = pytest.mark.slow


@pytest.fixture
def draw(monkeypatch, tmp_path):
    """Runs the command in the test's folder."""

    def run(*arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["plot", *map(str, arguments)])
        plot.main()

    return run


def test_it_draws_runs_and_the_reports_figures(tmp_path, make_run, draw, capsys):
    make_run(tmp_path / "run")
    (tmp_path / "mine.csv").write_text(
        "robot,observations,iteration,mean_reward,mean_value\ngecko,hinges,0,0.5,\n"
    )
    for arguments in (
        ("figure2", "run"),
        ("figure3", "run", "--reference", "mine.csv", "--output", "figure3.svg"),
        ("run", "--reference"),
    ):
        draw(*arguments)
    assert capsys.readouterr().out == "figure2.png\nfigure3.svg\nlearning_curves.png\n"
    assert "report" in (tmp_path / "figure3.svg").read_text()
    assert sorted(path.name for path in tmp_path.glob("*.??g")) == [
        "figure2.png",
        "figure3.svg",
        "learning_curves.png",
    ]
    assert (tmp_path / "learning_curves.png").read_bytes().startswith(b"\x89PNG")


def test_runs_that_have_no_row_yet_are_left_out(tmp_path, make_run, draw):
    make_run(tmp_path / "runs" / "a", "robot=ant")
    make_run(tmp_path / "runs" / "b", rewards=[])
    draw("runs", "--output", "runs.svg")
    draw("runs/a", "--output", "a.svg")
    texts = [(tmp_path / name).read_text().count("<!-- ") for name in ("runs.svg", "a.svg")]
    assert texts[0] == texts[1]


def test_what_a_pattern_matches_beside_runs_is_left_out(tmp_path, make_run, draw):
    make_run(tmp_path / "sweep" / "0")
    make_run(tmp_path / "sweep" / "1", "seed=1")
    draw("sweep/0", "sweep/1", "--output", "runs.svg")
    (tmp_path / "sweep" / "multirun.yaml").write_text("a: 1\n")
    (tmp_path / "sweep" / ".submitit" / "7").mkdir(parents=True)
    places = [f"sweep/{name}" for name in (".submitit", "0", "1", "multirun.yaml")]
    draw(*places, "--output", "all.svg")
    draw("figure2", *places)
    texts = [(tmp_path / name).read_text().count("<!-- ") for name in ("runs.svg", "all.svg")]
    assert texts[0] == texts[1]


def test_a_runs_folder_may_have_any_name(tmp_path, make_run, draw, recwarn):
    names = ["a$b$c", "$\\frac{$", "_hidden", "日本🦎", "<&>", "a,b=c"]
    for name in names:
        make_run(tmp_path / name)
    draw(*names, "--output", "runs.svg")
    draw(*names)
    svg = (tmp_path / "runs.svg").read_text(encoding="utf-8")
    for name in ("a$b$c", "$\\frac{$", "_hidden"):
        assert f"({name})" in svg
    assert not [warning for warning in recwarn if "Glyph" in str(warning.message)]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run/metrics.csv"], "run/metrics.csv is a file, so it is not a run's folder"),
        (["run", "runn"], "runn holds no metrics.csv, so it is not a run's folder"),
        (["nowhere"], "nowhere holds no metrics.csv, so it is not a run's folder"),
        (["figure3", "."], "no run in . has a row yet"),
        (["figure2"], "figure2 of what? Give the folder of a sweep: figure2 sweeps/ablation"),
        (["figure2", ".", "--reference", "no.csv"], "no.csv: No such file or directory"),
        (["figure2", ".", "--reference", "bad.csv"], "bad.csv has no column mean_reward"),
        (["figure2", ".", "--reference", "torn.csv"], "torn.csv, line 2: could not convert"),
        (["run"], "run/metrics.csv has no row yet"),
    ],
)
def test_a_wrong_plot_ends_in_one_line(arguments, message, tmp_path, make_run, draw, capsys):
    make_run(tmp_path / "run", rewards=[])
    (tmp_path / "bad.csv").write_text("robot,observations,iteration\ngecko,hinges,0\n")
    (tmp_path / "torn.csv").write_text(
        "robot,observations,iteration,mean_reward,mean_value\ngecko,hinges,0,much,1\n"
    )
    with pytest.raises(SystemExit) as ended:
        draw(*arguments)
    printed = capsys.readouterr()
    assert ended.value.code == 2
    assert printed.err.startswith(f"error: {message}")
    assert printed.err.count("\n") == 1


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("curves.jpgg", "error: curves.jpgg: not the ending of a picture; choose from"),
        ("no/curves.png", "error: no/curves.png: No such file or directory"),
    ],
)
def test_a_picture_that_cannot_be_written_is_named(output, message, tmp_path, make_run, command):
    make_run(tmp_path / "run")
    result = command("plot", "run", "--output", output, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr.startswith(message)
    assert result.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
