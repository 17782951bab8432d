"""A run that was trained with parts of somebody's own walks with them, or says that it cannot."""

import pytest
import torch
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.envs import ObservationNorm

from locomotion import compose, train
from locomotion.agents.architectures import MLP
from locomotion.envs import LocomotionEnv
from locomotion.evaluation import Controller, PolicyRunner, load_policy, make_runner, measure, walk
from locomotion.options import ConfigError
from locomotion.runs import RunError
from locomotion.training.build import make_env

pytestmark = pytest.mark.slow

SMALL = ("env.num_envs=2", "ppo.steps=2", "ppo.minibatch_size=2", "ppo.iterations=1")
#: By the argument: how it is made for a run of two robots.
PARTS = {
    "env": lambda: LocomotionEnv("ant", 2, readings=["hinge_position"]),
    "transforms": lambda: [ObservationNorm(0.0, 100.0, ["hinge_position"])],
    "in_keys": lambda: ["core_orientation"],
    "network": lambda: MLP(width=16),
    "learner": lambda: (
        lambda env: compose(*SMALL).learner.make(env, MLP(), ["hinge_position"], ["hinge_position"])
    ),
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The folder of a run for each part, and what was passed."""
    folder, found = tmp_path_factory.mktemp("runs"), {}
    for part, make in PARTS.items():
        passed = {part: make()}
        if part == "env":
            passed["in_keys"] = ["hinge_position"]
        found[part] = train(compose(*SMALL), folder / part, **passed).folder, passed
    return found


@pytest.mark.parametrize("part", PARTS)
def test_without_them_it_is_refused_by_name(part, runs):
    run, _ = runs[part]
    with pytest.raises(RunError) as refused:
        make_runner(run, compose(*SMALL))
    assert str(refused.value).startswith(f"{run} was trained with {part}=")
    assert f"locomotion.evaluation.make_runner takes {part}" in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("part", PARTS)
def test_with_them_it_walks(part, runs):
    run, passed = runs[part]
    runner = make_runner(run, compose(*SMALL), **passed)
    assert measure(walk(runner, 1.0))["speed"].isfinite().all()
    if part == "transforms":  # they count
        env = make_env(compose(*SMALL))
        bare = PolicyRunner(env, load_policy(run, compose(*SMALL), env))
        torch.manual_seed(0)
        assert not torch.equal(walk(runner, 1.0).position, walk(bare, 1.0).position)


def test_any_policy_walks_in_any_environment_around_the_robots():
    env = LocomotionEnv("gecko", 2)
    policy = TensorDictModule(nn.Linear(6, 6), ["hinge_position"], ["action"])
    assert measure(walk(PolicyRunner(env, policy), 1.0))["distance"].shape == (2,)


def test_a_controller_has_no_transforms_of_somebodys_own(runs):
    run, passed = runs["transforms"]
    config = compose(*SMALL)
    env = make_env(config, **passed)
    with pytest.raises(ConfigError, match="has not the environment's own ObservationNorm"):
        Controller(config, env, load_policy(run, config, env))


@pytest.mark.parametrize(
    ("name", "part"), [("evaluate", "transforms"), ("watch", "network"), ("export", "transforms")]
)
def test_commands_refuse_it_in_one_line(name, part, runs, tmp_path, command):
    run, _ = runs[part]
    options = {"evaluate": ["seconds=1"], "watch": ["web=true"], "export": ["output=gait.pt2"]}[
        name
    ]
    result = command(name, f"run={run}", *options, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr.startswith(f"error: {run} was trained with {part}=")
    assert result.stderr.count("\n") == 1
    assert not [*tmp_path.iterdir()]
