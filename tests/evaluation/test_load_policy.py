"""The policy of a run's last checkpoint, or a line about why there is none."""

import math

import pytest
import torch

from locomotion import compose
from locomotion.evaluation import load_policy
from locomotion.runs import RunError
from locomotion.runs.checkpoints import Checkpoints
from locomotion.training.build import make_env, make_learner


@pytest.fixture
def config():
    return compose("env.num_envs=2", "ppo.minibatch_size=1")


@pytest.fixture
def env(config):
    return make_env(config)


def test_it_is_the_last_ones_without_gradients(config, env, tmp_path):
    policies = [make_learner(config, env).policy for _ in range(2)]
    for number, policy in enumerate(policies):
        Checkpoints(tmp_path, policy=policy).save(number + 1)
    loaded = load_policy(tmp_path, config, env)
    weights = loaded.state_dict()
    assert all(torch.equal(weights[name], x) for name, x in policies[-1].state_dict().items())
    assert not any(parameter.requires_grad for parameter in loaded.parameters())


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_weights_that_are_not_finite_are_refused_by_the_checkpoints_name(
    wrong, config, env, tmp_path
):
    policy = make_learner(config, env).policy
    Checkpoints(tmp_path, policy=policy).save(1)
    next(policy.parameters()).data[0] = wrong
    path = Checkpoints(tmp_path, policy=policy).save(2)
    with pytest.raises(RunError) as refused:
        load_policy(tmp_path, config, env)
    assert str(refused.value).startswith(f"{path} holds a policy with weights that are not finite")


def test_a_folder_without_one_and_one_of_another_network_are_named(config, env, tmp_path):
    with pytest.raises(RunError, match=f"{tmp_path} holds no checkpoint yet"):
        load_policy(tmp_path, config, env)
    path = Checkpoints(tmp_path, policy=make_learner(config, env).policy).save(3)
    wider = compose("env.num_envs=2", "ppo.minibatch_size=1", "network.width=8")
    with pytest.raises(RunError, match=f"{path} does not fit this run"):
        load_policy(tmp_path, wider, env)
