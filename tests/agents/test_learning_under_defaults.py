"""Learning depends neither on torch's default dtype nor on its default device."""

import csv

import pytest
import torch
from torchrl.collectors import Collector
from torchrl.envs import Compose, TransformedEnv

from locomotion import compose, train
from locomotion.agents.architectures import GRU, MLP
from locomotion.agents.learners import PPOConfig

pytestmark = pytest.mark.slow

NETWORKS = {"mlp": lambda: MLP(width=8, hidden=[8]), "gru": lambda: GRU(width=8, hidden_size=7)}


@pytest.mark.parametrize("network", NETWORKS)
def test_a_learner_has_the_same_weights_and_learns_the_same(network, others_defaults, target_env):
    environments = [target_env(6, 4) for _ in range(2)]
    batches = []

    def learned():
        """From the same experience, which is collected without other people's defaults."""
        torch.manual_seed(0)
        architecture, base = NETWORKS[network](), environments.pop()
        env = TransformedEnv(base, Compose(*architecture.make_transforms()))
        config = PPOConfig(steps=10, minibatch_size=20, epochs=2, iterations=4, max_grad_norm=1.0)
        learner = config.make(env, architecture, ["target"], ["target"])
        if not batches:
            collector = Collector(
                env,
                learner.policy,
                frames_per_batch=60,
                total_frames=60,
                track_traj_ids=False,
                auto_register_policy_transforms=False,
            )
            batches.extend(collector)
        torch.manual_seed(1)
        metrics = learner.update(batches[0].clone())
        parts = (learner.policy, learner.critic)
        return metrics, [value for part in parts for value in part.state_dict().values()]

    metrics, weights = learned()
    with others_defaults:
        other_metrics, other_weights = learned()
    assert other_metrics == metrics
    for one, other in zip(weights, other_weights, strict=True):
        torch.testing.assert_close(other, one, atol=0, rtol=0)


@pytest.mark.parametrize("network", NETWORKS)
def test_a_run_is_the_same(network, others_defaults, tmp_path):
    overrides = ("+obs=history3", f"network={network}", "env.num_envs=4", "env.time_limit=1")
    short = ("ppo.iterations=2", "ppo.steps=8", "ppo.minibatch_size=16", "physics.threads=1")

    def run(name):
        result = train(compose(*overrides, *short), tmp_path / name)
        with (result.folder / "metrics.csv").open() as file:
            rows = list(csv.DictReader(file))
        return [{k: v for k, v in row.items() if not k.endswith("seconds")} for row in rows]

    expected = run("plain")
    with others_defaults:
        found = run("other")
    assert found == expected and len(found) == 2


def test_a_network_takes_observations_of_any_precision():
    torch.manual_seed(0)
    network = MLP().make_network({"place": 3}, 6).net
    place = torch.randn(4, 3, dtype=torch.float64)
    assert torch.equal(network([place]), network([place.float()]))
