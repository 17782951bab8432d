"""The reality check: one change at a time, and shares of the speed without."""

import dataclasses
import math

import pytest
import torch

from locomotion import compose
from locomotion.evaluation import (
    PERTURBATIONS,
    check_robustness,
    make_runner,
    measure,
    perturbed,
    walk,
)
from locomotion.robots.geometry import HINGE_SPEED

pytestmark = pytest.mark.slow

ROWS = [
    *("physics.timestep=0.001", "physics.self_collision=true"),
    *("disturbances.friction=0.5", "disturbances.friction=1.5"),
    *("disturbances.strength=0.8", "disturbances.strength=1.2"),
    *("disturbances.stiffness=0.8", "disturbances.damping=0.8"),
    *("disturbances.mass=0.8", "disturbances.mass=1.2"),
    *("disturbances.hinge_friction=0.05", "disturbances.backlash=0.05"),
    "disturbances.top_speed=6.33897",
    "disturbances.battery=0.8 disturbances.top_speed=6.33897",
    *("disturbances.latency=0.25", "disturbances.dropped=0.1", "disturbances.sensor_latency=0.1"),
    *("disturbances.hinge_noise=0.05", "disturbances.hinge_bias=0.05"),
    "disturbances.orientation_noise=0.05 disturbances.speed_noise=0.2",
    "disturbances.orientation_bias=0.1 disturbances.gyro_bias=0.1",
    *("disturbances.push=0.5", "disturbances.stuck=1"),
    *("arena=rough arena.height=0.04", "arena=slopes arena.height=0.4"),
    *("arena=steps arena.height=0.03", "arena=stones arena.height=0.05"),
]


def test_each_row_is_a_walk_under_its_overrides(shipped_run):
    run, config = shipped_run("gecko", 4, self_collision=False)
    steps = []
    nominal = measure(walk(make_runner(run, config), 1.0))["speed"]
    rows = list(check_robustness(run, config, 1.0, nominal, progress=lambda: steps.append(1)))
    assert len(steps) == 4 * len(PERTURBATIONS)
    assert [row.override for row in rows] == ROWS
    for row in rows:
        assert row.share.low < row.share.mean < row.share.high
        assert row.share.mean == pytest.approx(row.speed / nominal.mean().item())
    for row in rows[::4]:
        task = {"physics": {"self_collision": False}, "disturbances": {}}
        task["arena"] = {"name": "ground"}
        for word in row.override.split():
            key, _, value = word.partition("=")
            group, _, name = key.partition(".")
            # The one figure that a table rounds.
            if group == "arena":
                task["arena"] = (
                    {"name": value} if not name else task["arena"] | {name: float(value)}
                )
                continue
            value = {"true": True, "6.33897": HINGE_SPEED}.get(value) or float(value)
            task[group][name] = value
        folder, again = shipped_run("gecko", 4, task["disturbances"], **task["physics"])
        again = make_runner(folder, dataclasses.replace(again, arena=task["arena"]))
        assert row.speed == measure(walk(again, 1.0))["speed"].mean().item()


def test_changes_come_on_top_of_the_task_and_those_that_change_nothing_are_left_out():
    changed = ("latency=0.1", "friction=0.8", "mass=[0.5,1.0]", "top_speed=9")
    overrides = [f"disturbances.{word}" for word in changed]
    rows = [row[-1] for row in perturbed(compose("physics.self_collision=true", *overrides))]
    assert "physics.self_collision=true" not in rows
    for row in ("friction=0.4", "friction=1.2", "mass=[0.4,0.8]", "mass=[0.6,1.2]", "latency=0.35"):
        assert f"disturbances.{row}" in rows
    assert "disturbances.battery=0.8" in rows  # with the top speed that there is
    assert not [row for row in rows if "top_speed" in row]


def test_a_share_of_nothing_is_unknown_and_nothing_is_no_share(shipped_run):
    run, config = shipped_run("gecko", 2)
    row = next(check_robustness(run, config, 0.25, torch.tensor([math.nan, 0.0])))
    assert row.speed > 0
    assert all(map(math.isnan, (row.share.mean, row.share.low, row.share.high)))

    run, config = shipped_run("gecko", 2, stiffness=1000.0, timestep=0.25)
    rows = check_robustness(run, config, 0.25, torch.tensor([0.5, 0.7]))
    row = next(row for row in rows if row.diverged == 1)
    # This counts as standing still.
    assert (row.speed, row.share.mean, row.share.low, row.share.high) == (0, 0, 0, 0)
