"""The reality check: one change at a time, and shares of the speed without."""

import math

import pytest
import torch

from locomotion import compose
from locomotion.evaluation import CHANGES, Disturbances, make_walker, measure, planned, shares, walk

pytestmark = pytest.mark.slow

ROWS = [
    *("physics.timestep=0.001", "physics.self_collision=true"),
    *("physics.friction=0.5", "physics.friction=1.5"),
    *("physics.strength_scale=0.8", "physics.strength_scale=1.2"),
    *("physics.mass_scale=0.8", "physics.mass_scale=1.2"),
    *("physics.latency=0.25", "noise=0.05", "push=0.5"),
]


def test_each_row_is_a_walk_under_its_override(shipped_run):
    run, config = shipped_run("gecko", 4, self_collision=False)
    steps = []
    nominal = measure(walk(make_walker(run, config), 1.0))["speed"]
    rows = shares(run, config, Disturbances(), 1.0, nominal, progress=lambda: steps.append(1))
    assert len(steps) == 4 * len(CHANGES)
    assert [row.override for row in rows] == ROWS
    for row in rows:
        assert row.share.low < row.share.mean < row.share.high
        assert row.share.mean == pytest.approx(row.speed / nominal.mean().item())
        key, _, value = row.override.partition("=")
        if key.startswith("physics."):
            value = {"true": True}.get(value) or float(value)
            task = {"self_collision": False, key.removeprefix("physics."): value}
            again = make_walker(*shipped_run("gecko", 4, **task))
            assert row.speed == measure(walk(again, 1.0))["speed"].mean().item()


def test_changes_come_on_top_of_the_task_and_those_that_change_nothing_are_left_out():
    config = compose("physics.self_collision=true", "physics.latency=0.1", "physics.friction=0.8")
    rows = [row[-1] for row in planned(config, Disturbances(noise=0.01, push=0.5))]
    assert "physics.self_collision=true" not in rows
    assert [row for row in rows if "friction" in row] == [
        "physics.friction=0.4",
        "physics.friction=1.2",
    ]
    assert rows[-3:] == ["physics.latency=0.35", "noise=0.06", "push=1"]


def test_a_share_of_nothing_is_unknown_and_nothing_is_no_share(shipped_run):
    run, config = shipped_run("gecko", 2)
    (row, *_) = shares(run, config, Disturbances(), 0.25, torch.tensor([math.nan, 0.0]))
    assert row.speed > 0
    assert all(map(math.isnan, (row.share.mean, row.share.low, row.share.high)))

    run, config = shipped_run("gecko", 2, stiffness=1000.0, timestep=0.25)
    rows = shares(run, config, Disturbances(), 0.25, torch.tensor([0.5, 0.7]))
    lost = [row for row in rows if row.diverged == 1]
    assert lost
    for row in lost:  # these count as standing still
        assert (row.speed, row.share.mean, row.share.low, row.share.high) == (0, 0, 0, 0)
