"""Optimiser, schedule and minibatches are those that were asked for."""

import copy

import pytest
import torch

from locomotion import compose
from locomotion.agents.architectures import GRU, MLP
from locomotion.agents.learners import Optimizer, PPOConfig, Schedule
from locomotion.options import ConfigError, typed

pytestmark = pytest.mark.slow

PLAIN = {"optimizer": Optimizer.sgd, "schedule": Schedule.constant, "actor_lr": 1.0}


def steps_of(learner):
    """The parameters before each gradient step and after the last, and the gradients."""
    groups = learner.optimizer.param_groups
    values, gradients = [], []

    def before(*_):
        values.append([[p.detach().clone() for p in group["params"]] for group in groups])
        gradients.append([[p.grad.clone() for p in group["params"]] for group in groups])

    def after(*_):
        values[len(gradients) :] = [
            [[p.detach().clone() for p in group["params"]] for group in groups]
        ]

    learner.optimizer.register_step_pre_hook(before)
    learner.optimizer.register_step_post_hook(after)
    return values, gradients


def length(gradient):
    return torch.cat([part.flatten() for part in gradient]).norm().item()


@pytest.mark.parametrize("schedule", Schedule)
def test_learning_rates_follow_their_schedule(experience, schedule):
    options = {"schedule": schedule, "actor_lr": 0.02, "critic_lr": 0.03, "iterations": 4}
    learner, batches = experience(batches=4, **options)
    shares = {Schedule.linear: [1.0, 0.75, 0.5, 0.25], Schedule.constant: [1.0] * 4}[schedule]
    for batch, share in zip(batches, shares, strict=True):
        rates = [group["lr"] for group in learner.optimizer.param_groups]
        assert rates == pytest.approx([0.02 * share, 0.03 * share])
        assert learner.learning_rate == pytest.approx(0.02 * share)
        assert learner.update(batch)["actor_lr"] == pytest.approx(0.02 * share)


@pytest.mark.parametrize(
    ("network", "minibatch_size", "expected"),
    [
        ("mlp", 60, 1),
        ("mlp", 20, 3),
        ("mlp", 25, 3),  # the last one is smaller
        ("gru", 60, 1),
        ("gru", 20, 3),  # two robots with all their steps
        ("gru", 1, 6),  # never less than one
    ],
)
def test_each_epoch_takes_all_minibatches(experience, network, minibatch_size, expected):
    learner, (batch,) = experience(network, epochs=3, minibatch_size=minibatch_size)
    _, gradients = steps_of(learner)
    learner.update(batch)
    assert len(gradients) == 3 * expected


@pytest.mark.parametrize(
    ("kind", "make"),
    [
        (Optimizer.adam, torch.optim.Adam),
        (Optimizer.adamw, torch.optim.AdamW),
        (Optimizer.rmsprop, torch.optim.RMSprop),
        (Optimizer.sgd, torch.optim.SGD),
    ],
)
def test_an_optimiser_with_options_is_torchs(experience, kind, make):
    options = {
        Optimizer.adam: {"betas": [0.5, 0.9], "eps": 1e-3},
        Optimizer.adamw: {"weight_decay": 0.3},
        Optimizer.rmsprop: {"alpha": 0.5, "centered": True},
        Optimizer.sgd: {"momentum": 0.9, "nesterov": True, "weight_decay": 0.1},
    }[kind]
    asked = {"optimizer": kind, "optimizer_options": options, "actor_lr": 0.1, "critic_lr": 0.2}
    learner, (batch,) = experience(schedule=Schedule.constant, epochs=3, **asked)
    values, gradients = steps_of(learner)
    learner.update(batch)
    for group, rate in enumerate((0.1, 0.2)):
        parameters = [torch.nn.Parameter(value) for value in values[0][group]]
        reference = make(parameters, lr=rate, **options)
        for step in gradients:
            for parameter, gradient in zip(parameters, step[group]):
                parameter.grad = gradient
            reference.step()
        torch.testing.assert_close(
            [parameter.detach() for parameter in parameters], values[-1][group]
        )


def test_long_gradients_are_shortened_for_actor_and_critic_each(experience):
    lengths = []
    for longest in (None, 0.05):
        learner, (batch,) = experience(**PLAIN, critic_lr=1.0, max_grad_norm=longest)
        values, gradients = steps_of(learner)
        learner.update(batch)
        lengths.append([length(gradient) for gradient in gradients[0]])
        steps = [
            [before - after for before, after in zip(*group)]
            for group in zip(values[0], values[-1])
        ]
        lengths[-1] += [length(step) for step in steps]
    free, limited = lengths
    assert min(free) > 0.05
    assert limited == pytest.approx([0.05] * 4, rel=1e-3)


def test_short_gradients_stay_as_they_are(experience):
    ends = []
    for longest in (None, 1e6):
        learner, (batch,) = experience(**PLAIN, max_grad_norm=longest)
        values, _ = steps_of(learner)
        learner.update(batch)
        ends.append(values[-1])
    torch.testing.assert_close(*ends, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        (Optimizer.adam, {"momentum": 0.9}, "momentum"),
        (Optimizer.sgd, {"momentum": -1}, "momentum"),
        (Optimizer.adamw, {"betas": 3}, "betas"),
    ],
)
def test_options_that_an_optimiser_has_not_are_named(experience, kind, options, words):
    with pytest.raises(ConfigError, match=rf"ppo\.optimizer_options=.*{words}") as caught:
        experience(optimizer=kind, optimizer_options=options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"optimizer": "lion"}, "ppo.optimizer"),
        ({"schedule": "cosine"}, "ppo.schedule"),
        ({"max_grad_norm": 0.0}, "ppo.max_grad_norm=0.0 must be above 0"),
        ({"actor_lr": 0.0}, "ppo.actor_lr=0.0 must be above 0"),
        ({"epoch": 3}, "did you mean ppo.epochs"),
        ({"steps": 0}, "ppo.steps=0 must be at least 1"),
    ],
)
def test_values_out_of_range_are_named(values, words):
    with pytest.raises(ConfigError, match=words.replace(".", r"\.")):
        typed(PPOConfig, values)


@pytest.mark.parametrize("spoil", ["loss", "weight"])
@pytest.mark.parametrize("network", ["mlp", "gru"])
def test_what_is_no_longer_a_finite_number_is_named(experience, network, spoil):
    learner, (batch,) = experience(network)
    if spoil == "loss":
        batch["action_log_prob"][0, 0] = float("nan")
    else:
        weight = learner.optimizer.param_groups[1]["params"][0]
        learner.optimizer.register_step_post_hook(lambda *_: weight.data.fill_(float("inf")))
    words = {"loss": "the loss", "weight": "a weight"}[spoil]
    with pytest.raises(FloatingPointError, match=f"{words} is no longer a finite number"):
        learner.update(batch)


@pytest.mark.parametrize("network", ["mlp", "gru"])
@pytest.mark.parametrize("kind", Optimizer)
def test_a_learner_goes_on_from_its_state(experience, network, kind):
    options = {"batches": 3, "optimizer": kind, "epochs": 2, "minibatch_size": 20}
    learner, batches = experience(network, **options)
    learner.update(batches[0].clone())
    policy, state = copy.deepcopy((learner.policy.state_dict(), learner.state_dict()))
    again, _ = experience(network, **options)
    again.policy.load_state_dict(policy)
    again.load_state_dict(state)
    results = []
    for each in (learner, again):
        torch.manual_seed(1)
        results.append([each.update(batch.clone()) for batch in batches[1:]])
    assert results[0] == results[1]


def test_a_graph_is_not_asked_to_follow_a_memory(target_env):
    learner = PPOConfig(cudagraphs=True)
    learner.check_network(MLP())
    with pytest.raises(ConfigError, match=r"ppo\.cudagraphs=True needs a network without a memory"):
        learner.check_network(GRU())
    with pytest.raises(ConfigError, match="needs a network without a memory"):
        learner.make(target_env(2), GRU(), ["target"], [])
    overrides = ("physics=warp", "physics.device=cuda:0", "ppo.cudagraphs=true")
    with pytest.raises(ConfigError, match="needs a network without a memory"):
        compose(*overrides, "network=gru")
    assert compose(*overrides, "network=mlp").learner.cudagraphs
