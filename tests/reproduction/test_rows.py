"""Tables over bodies and over disturbances, from rows in files."""

import sys

import pytest

from reproduction import robustness, standard_bodies
from reproduction.rows import read, write

BODIES = [
    standard_bodies.Row(robot, seed, 6, 0.2, 0, speed, 0.9 * speed, speed, 0.5 * speed)
    for robot, speeds in {"gecko": (1.0, 0.8), "queen": (0.5, 0.5)}.items()
    for seed, speed in enumerate(speeds)
]
SHARES = [
    robustness.Row("gecko", trained, seed, change, override, value + 0.1 * seed)
    for trained in ("history3", "history3_targets, disturbed")
    for seed in (0, 1)
    for change, override, value in [
        (robustness.NOMINAL, "", 0.8),
        ("half the friction", "disturbances.friction=0.5", 0.6),
    ]
]


@pytest.mark.parametrize("rows", [BODIES, SHARES], ids=["bodies", "shares"])
def test_what_was_written_is_read_again(rows, tmp_path):
    write(tmp_path / "rows.csv", rows)
    assert read(type(rows[0]), tmp_path / "rows.csv") == [
        type(row)(**{k: round(v, 4) if isinstance(v, float) else v for k, v in vars(row).items()})
        for row in rows
    ]


def test_a_table_has_a_row_a_body_the_fastest_first_and_those_held_back_apart(
    tmp_path, monkeypatch, capsys
):
    write(tmp_path / "rows.csv", BODIES)
    monkeypatch.setattr(sys, "argv", ["standard_bodies", str(tmp_path / "rows.csv")])
    standard_bodies.main()
    lines = capsys.readouterr().out.splitlines()
    assert lines[2].startswith("| gecko | 6 |") and "0.90 (0.80 to 1.00)" in lines[2]
    assert lines[3].startswith("| queen | 6 |")
    assert "2 all bodies: 0.70 m/s on average, the slowest 0.50" in "\n".join(lines)
    assert "1 held back: 0.50 m/s" in "\n".join(lines)
    assert "90% of the speed after that, from any start 50%" in "\n".join(lines)


def test_shares_have_a_column_for_each_way_of_training(tmp_path, monkeypatch, capsys):
    write(tmp_path / "rows.csv", SHARES)
    monkeypatch.setattr(sys, "argv", ["robustness", str(tmp_path / "rows.csv")])
    robustness.main()
    lines = capsys.readouterr().out.splitlines()
    assert "| gecko |  | history3 | history3_targets, disturbed |" in lines
    (friction,) = (line for line in lines if "half the friction" in line)
    # The mean of 60% and 70%; Student's t of two seeds is wide.
    assert friction.count("65% [2%, 129%]") == 2 or friction.count("65% [1%, 129%]") == 2
