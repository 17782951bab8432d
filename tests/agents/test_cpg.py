"""Central pattern generators, against an integrator, and CMA-ES against itself uninterrupted."""

import csv

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from tensordict import TensorDict

from locomotion import compose, train
from locomotion.agents.oscillators import OSCILLATORS, Oscillators, near_hinges
from locomotion.evaluation import make_runner, measure, walk
from locomotion.options import ConfigError
from locomotion.robots import load_robot, parse_body

PERIOD, FREQUENCY = 0.25, 1.3
COUPLINGS = [(0, 1), (1, 2)]
SMALL = [
    *("algorithm=cpg", "env.num_envs=8", "env.time_limit=1", "cpg.steps=4", "cpg.population=4"),
    "cpg.iterations=6",
]


def walked(policy, steps):
    td, actions, neurons = TensorDict({OSCILLATORS: torch.zeros(6)}), [], []
    for _ in range(steps):
        td = policy(td)
        actions.append(td["action"])
        td = TensorDict({OSCILLATORS: td["next", OSCILLATORS]})
        neurons.append(td[OSCILLATORS] + policy.start)
    return torch.stack(actions), torch.stack(neurons)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(-3, 3), min_size=5, max_size=5))
def test_neurons_follow_their_equations_and_none_grows(weights):
    policy = Oscillators(3, COUPLINGS, PERIOD, 1.0, FREQUENCY)
    policy.set_weights(torch.tensor(weights))
    actions, neurons = walked(policy, 8)
    turn = 2 * np.pi * FREQUENCY

    def change(_, state):
        x, y = state[:3], state[3:]
        rate = np.concatenate([np.multiply(weights[:3], y), np.multiply(weights[:3], -x)])
        for weight, (one, other) in zip(weights[3:], COUPLINGS, strict=True):
            rate[one] += weight * x[other]
            rate[other] -= weight * x[one]
        return turn * rate

    times = PERIOD * np.arange(1, 9)
    start = np.repeat([0.5**0.5, -(0.5**0.5)], 3)
    solved = solve_ivp(change, (0, times[-1]), start, t_eval=times, rtol=1e-9, atol=1e-9).y.T
    np.testing.assert_allclose(neurons, solved, atol=2e-4)
    np.testing.assert_allclose(actions, solved[:, :3].clip(-1, 1), atol=2e-4)
    torch.testing.assert_close(neurons.norm(dim=1), torch.full((8,), 3**0.5))


def test_hinges_are_coupled_with_those_near_in_the_body():
    hinge = {"module": "hinge"}
    arm = {**hinge, "children": {"attachment": {"module": "brick", "children": {"front": hinge}}}}
    body = parse_body({"module": "core", "children": {"front": arm, "left": hinge}})
    # In order: front, beyond its brick, left.
    assert near_hinges(body, 0) == near_hinges(body, 1) == []
    assert near_hinges(body, 2) == [(0, 1), (0, 2)]
    assert near_hinges(body, 4) == [(0, 1), (0, 2), (1, 2)]
    gecko = parse_body(load_robot("gecko").body)
    assert len(near_hinges(gecko, 100)) == 15


@pytest.mark.slow
def test_a_search_gets_better_and_its_best_weights_walk(tmp_path):
    config = compose(*SMALL)
    train(config, tmp_path)
    with (tmp_path / "metrics.csv").open() as file:
        best = [float(row["best_reward"]) for row in csv.DictReader(file)]
    assert best == sorted(best) and best[-1] > best[0]
    drawn, mean = (walk(make_runner(tmp_path, config), 5.0, sampled=how) for how in (True, False))
    assert torch.equal(drawn.position, mean.position)
    assert (measure(mean)["speed"] > 0).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("cpg.population=5", "cpg.population=5 must divide env.num_envs=8"),
        (
            "env.control_frequency=20",
            "cpg.steps=4 must be the control steps of an episode, 20 with",
        ),
        ("env.time_limit=null", "cpg.steps=4 must be the control steps of an episode, 0 with"),
        ("env.stagger=true", "env.stagger=True must be False with algorithm=cpg"),
        ("cpg.reach=-1", "cpg.reach=-1 must be at least 0"),
    ],
)
def test_what_a_search_cannot_do_is_refused(change, message):
    with pytest.raises(ConfigError) as caught:
        compose(*SMALL, change)
    assert message in str(caught.value)
