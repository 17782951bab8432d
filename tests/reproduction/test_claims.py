"""The numbers that the report's claims are held against."""

import sys

import numpy as np
import pytest

from locomotion import compose
from locomotion.config import as_dict
from locomotion.plots import REPORT, Curve, read_csv
from locomotion.runs import record
from reproduction import ablation, claims


def curve(robot="gecko", observations="hinges", seed=0, rewards=(0.0, 0.1)):
    rewards = np.array(rewards)
    return Curve(robot, observations, seed, np.arange(len(rewards)), rewards, 80 * rewards)


@pytest.mark.parametrize(
    ("setting", "last_ten", "above_8"),
    [
        (("gecko", "history3"), 0.0870, 49),
        (("gecko", "hinges_orientation"), 0.0919, 92),
        (("gecko", "hinges"), 0.0047, np.inf),
        (("ant", "history3"), 0.0831, 108),
        (("ant", "hinges_orientation"), 0.0824, 143),
        (("ant", "hinges"), 0.0016, np.inf),
    ],
)
def test_the_reports_curves_have_the_numbers_read_off_its_figures(setting, last_ten, above_8):
    (known,) = (c for c in read_csv(REPORT) if (c.robot, c.observations) == setting)
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
    def draw(*arguments):
        monkeypatch.setattr(sys, "argv", ["ablation", *map(str, arguments)])
        ablation.main()
        return capsys.readouterr()

    for seed, rewards in enumerate([(0.1, 0.2), (0.3, 0.4), (0.5,)]):
        folder = tmp_path / str(seed)
        record(folder, config=as_dict(compose(f"seed={seed}")))
        rows = [f"{i},{(i + 1) * 64},{reward},{80 * reward}\n" for i, reward in enumerate(rewards)]
        columns = "iteration,frames,mean_reward,mean_value\n"
        (folder / "metrics.csv").write_text("".join([columns, *rows]))
    printed = draw(tmp_path, "--output", tmp_path / "one")
    assert "gecko | hinges_orientation | 2 | 0.2500 [-1.0206, 1.5206] | 0.0919" in printed.out
    assert printed.err.count("\n") == 1
    assert "gecko, hinges_orientation, seed 2, 1 of 2 iterations" in printed.err
    draw(tmp_path / "one" / "curves.csv", "--output", tmp_path / "two")
    for name in ("curves.csv", "summary.md", "figure2.png", "figure3.png"):
        content = (tmp_path / "one" / name).read_bytes()
        assert content and content == (tmp_path / "two" / name).read_bytes()
