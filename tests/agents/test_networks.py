"""Networks as the report draws them, and a Gaussian policy that is TorchRL's."""

import contextlib
import itertools

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import nn
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import ExplorationType, set_exploration_type
from torchrl.modules import IndependentNormal, ProbabilisticActor

from locomotion.agents.architectures import GRU, MLP
from locomotion.agents.networks import GaussianActor, ObservationNet

OBSERVATIONS = Composite(hinges=Unbounded((4, 18)), orientation=Unbounded((4, 4)), shape=(4,))
SIZES = {"hinges": 18, "orientation": 4}
ACTION = Bounded(-1, 1, shape=(4, 6))
#: TorchRL's distribution has no median.
KINDS = [None, *(kind for kind in ExplorationType if kind is not ExplorationType.MEDIAN)]


def parameters(module):
    return sum(parameter.numel() for parameter in module.parameters())


def test_the_default_has_the_reports_layers():
    torch.manual_seed(0)
    actor, critic = MLP().make_actor(SIZES, ACTION), MLP().make_critic(SIZES)
    encoders = (18 * 32 + 32) + (4 * 32 + 32) + (64 * 32 + 32)
    assert parameters(critic) == encoders + 32 + 1
    assert parameters(actor) == encoders + 6 * 32 + 6 + 6  # six log standard deviations
    td = actor(OBSERVATIONS.rand())
    assert torch.equal(td["scale"], torch.ones(4, 6))
    assert critic(td)["state_value"].shape == (4, 1)


@pytest.mark.parametrize("hidden", [[], [32], [24, 7, 5]])
def test_a_network_is_the_function_that_its_layers_say(hidden):
    torch.manual_seed(0)
    net = ObservationNet([18, 4], 6, 16, hidden)
    layers = [layer for layer in net.modules() if isinstance(layer, nn.Linear)]
    widths = [32, *hidden, 6]
    shapes = [(18, 16), (4, 16), *itertools.pairwise(widths)]
    assert [(layer.in_features, layer.out_features) for layer in layers] == shapes
    first, second, *rest = layers
    observations = [3 * torch.randn(50, 18), torch.randn(50, 4)]
    expected = torch.cat([first(observations[0]), second(observations[1])], -1)
    for layer in rest:
        expected = layer(torch.tanh(expected))
    torch.testing.assert_close(net(observations), expected)


def test_options_shape_actor_and_critic():
    network = MLP(initial_deviation=0.3, width=8, hidden=[5, 4])
    actor, critic = network.make_actor(SIZES, ACTION), network.make_critic(SIZES)
    encoders = (18 * 8 + 8) + (4 * 8 + 8) + (16 * 5 + 5) + (5 * 4 + 4)
    assert parameters(critic) == encoders + 4 + 1
    assert parameters(actor) == encoders + 4 * 6 + 6 + 6
    torch.testing.assert_close(actor(OBSERVATIONS.rand())["scale"], torch.full((4, 6), 0.3))


@pytest.mark.parametrize("network", [MLP, GRU])
def test_the_first_mean_actions_are_scaled_by_the_gain(network):
    observations = OBSERVATIONS.rand()
    locs = []
    for gain in (1.0, 0.01, 0.0):
        torch.manual_seed(0)
        architecture = network(initial_gain=gain)
        td = observations.clone()
        if network is GRU:
            memory = torch.zeros(4, architecture.layers, architecture.hidden_size)
            td.update({"recurrent_state": memory, "is_init": torch.zeros(4, 1, dtype=torch.bool)})
        locs.append(architecture.make_actor(SIZES, ACTION)(td)["loc"])
    torch.testing.assert_close(locs[1], 0.01 * locs[0])
    assert locs[0].abs().max() > 0.01
    assert not locs[2].any()


@pytest.fixture
def both():
    """A Gaussian policy, and one with the same parameters put together from TorchRL's parts."""
    torch.manual_seed(0)
    network = TensorDictModule(nn.Linear(18, 6), ["hinges"], ["loc"])
    ours = GaussianActor(network, ACTION, 0.7)
    (log_scale,) = [value for name, value in ours.named_parameters() if name.endswith("log_scale")]
    with torch.no_grad():
        log_scale.add_(0.5 * torch.randn(6))
    scale = TensorDictModule(lambda loc: log_scale.exp().expand_as(loc), ["loc"], ["scale"])
    plain = ProbabilisticActor(
        TensorDictSequential(network, scale),
        in_keys=["loc", "scale"],
        distribution_class=IndependentNormal,
        return_log_prob=True,
        spec=ACTION,
    )
    return ours, plain


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("shape", [(4,), (4, 3), ()])
def test_a_gaussian_actor_is_a_plain_probabilistic_actor(both, kind, shape):
    observation = TensorDict({"hinges": torch.randn(*shape, 18)}, shape)
    written = []
    for actor in both:
        torch.manual_seed(1)
        with set_exploration_type(kind) if kind else contextlib.nullcontext():
            written.append(actor(observation.clone()))
    ours, plain = written
    assert set(ours.keys()) == set(plain.keys())
    for key in plain.keys(True, True):
        torch.testing.assert_close(ours[key], plain[key], msg=key)
    if kind is ExplorationType.RANDOM:
        assert (ours["action"] != ours["loc"]).all()
    for actor in both:
        distribution = actor.get_dist(observation.clone())
        log_prob = distribution.log_prob(ours["action"])
        torch.testing.assert_close(log_prob, ours["action_log_prob"])
    assert both[0].in_keys == both[1].in_keys


def test_samples_have_the_deviation_and_are_not_clipped(both):
    actor, _ = both
    observation = TensorDict({"hinges": torch.randn(1, 18)}, [1]).expand(20_000).clone()
    with set_exploration_type(ExplorationType.RANDOM), torch.no_grad():
        td = actor(observation)
    z = (td["action"] - td["loc"]) / td["scale"]
    assert td["action"].abs().max() > 1
    assert z.mean().abs() < 0.012  # four standard errors
    assert abs(z.std() - 1) < 0.01


def test_its_log_probability_has_the_gradients_of_the_plain_one(both):
    ours, plain = both
    action, observation = torch.randn(4, 6), TensorDict({"hinges": torch.randn(4, 18)}, [4])
    parameters = list(ours.parameters())
    found, expected = (
        torch.autograd.grad(actor.get_dist(observation.clone()).log_prob(action).sum(), parameters)
        for actor in (ours, plain)
    )
    torch.testing.assert_close(found, expected)
    assert all(gradient.abs().sum() > 0 for gradient in found)


@pytest.mark.parametrize("layers", [1, 2])
def test_a_gru_has_its_layers_and_a_critic_that_sees_its_memory(layers):
    network = GRU(width=8, hidden_size=10, layers=layers)
    actor, critic = network.make_actor(SIZES, ACTION), network.make_critic(SIZES)
    encoders = (18 * 8 + 8) + (4 * 8 + 8) + (16 * 10 + 10)
    assert parameters(actor) == encoders + layers * 2 * (3 * 10 * 10 + 3 * 10) + 10 * 6 + 6 + 6
    td = OBSERVATIONS.rand()
    td["recurrent_state"] = torch.zeros(4, layers, 10)
    td["is_init"] = torch.ones(4, 1, dtype=torch.bool)
    assert actor(td)["next", "recurrent_state"].shape == (4, layers, 10)
    first = critic(td)["state_value"].clone()
    td["recurrent_state"] += 1
    assert (critic(td)["state_value"] != first).all()


@pytest.mark.parametrize("kind", [None, *(k for k in ExplorationType if k.name != "RANDOM")])
def test_all_but_random_is_the_mean_which_evaluation_walks_with(kind):
    torch.manual_seed(0)
    actor = MLP().make_actor(SIZES, ACTION)
    seen = OBSERVATIONS.rand()
    with contextlib.nullcontext() if kind is None else set_exploration_type(kind):
        decided = actor(seen.clone())
    assert torch.equal(decided["action"], decided["loc"])
    with set_exploration_type(ExplorationType.RANDOM):
        assert not torch.equal(actor(seen.clone())["action"], decided["loc"])
