"""Measures of walks whose every number is known."""

import dataclasses
import math

import numpy as np
import pytest
import torch

from locomotion.evaluation import Trajectory, measure, summarise

LEVEL = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64)


def made_up(places, overturns=0.0, work=1.0, orientation=LEVEL):
    """The walk of one robot at 4 Hz through places ``(steps + 1, 2)``."""
    places = torch.as_tensor(places, dtype=torch.float64)
    steps = len(places) - 1
    position = torch.cat([places, torch.full((steps + 1, 1), 0.05)], 1).unsqueeze(1)
    overturns = torch.as_tensor(overturns, dtype=torch.float64).expand(steps, 1)
    joules = torch.full((steps, 1), work)
    still = torch.zeros(1, dtype=torch.bool)
    return Trajectory(0.25, position, orientation.expand(steps + 1, 1, 4), joules, overturns, still)


def test_a_straight_line():
    # 80 steps of 0.1 m along y, each with half a joule and a tenth of a turn over.
    places = [(0.0, 0.1 * step) for step in range(81)]
    found = measure(made_up(places, overturns=0.1, work=0.5))
    expected = {
        "speed": 0.4,
        "distance": 8.0,
        "straightness": 1.0,
        "heading_drift": 0.0,
        "work_per_metre": 5.0,
        "rolls_per_metre": 0.5,
        "on_back": 0.0,
        "diverged": 0.0,
    }
    assert {name: value.item() for name, value in found.items()} == pytest.approx(expected)


def test_a_walk_that_takes_time_to_get_going():
    # 20 s at 0.1 m/s, then 10 s at 0.4 m/s across.
    places = [(0.025 * step, 0.0) for step in range(81)]
    places += [(2.0, 0.1 * step) for step in range(1, 41)]
    found = measure(made_up(places))
    assert found["first_speed"].item() == pytest.approx(0.1)
    assert found["steady_speed"].item() == pytest.approx(0.4)
    assert found["speed"].item() == pytest.approx(math.hypot(2.0, 4.0) / 30)


def test_a_quarter_circle_drifts():
    angles = np.linspace(0, math.pi / 2, 241)  # one minute
    circle = 20 * np.stack([np.sin(angles), 1 - np.cos(angles)], 1)
    found = measure(made_up(circle))
    # Chords of the two halves are 45 degrees apart, and half a minute.
    assert found["heading_drift"].item() == pytest.approx(90.0)
    assert found["distance"].item() == pytest.approx(20 * math.sqrt(2))
    assert found["straightness"].item() == pytest.approx(2 * math.sqrt(2) / math.pi, rel=1e-3)


def test_upside_down_and_diverged():
    overturned = torch.tensor([0.0, 1.0, 0.0, 0.0], dtype=torch.float64)
    places = [(0.0, 0.0), (1.0, 0.0)]
    assert measure(made_up(places, orientation=overturned))["on_back"].item() == 1
    lost = dataclasses.replace(made_up(places), diverged=torch.ones(1, dtype=torch.bool))
    found = measure(lost)
    assert found["speed"].isnan().all()
    assert found["diverged"].item() == 1
    assert summarise(found)["diverged"].mean == 1


def test_of_a_robot_that_stood_still_nothing_is_known_per_metre():
    found = measure(made_up([(1.0, 2.0)] * 41))
    assert found["speed"].item() == 0
    for name in ("straightness", "work_per_metre", "rolls_per_metre"):
        assert found[name].isnan().all()


def test_intervals_cover_the_mean_as_often_as_they_say():
    generator = torch.Generator().manual_seed(0)
    covered = 0
    for _ in range(400):
        values = 2 + torch.randn(10, generator=generator, dtype=torch.float64)
        interval = summarise({"speed": values})["speed"]
        covered += interval.low < 2 < interval.high
    assert 0.92 < covered / 400 < 0.98
    none = summarise({"on_back": torch.zeros(64, dtype=torch.float64)})["on_back"]
    assert (none.mean, none.low) == (0, pytest.approx(0))
    assert none.high == pytest.approx(0.0566, abs=1e-3)  # Wilson: z² / (n + z²)
