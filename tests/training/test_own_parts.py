"""Environments, networks, learners and callbacks of one's own train without a fork."""

import dataclasses

import pytest
import torch
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.envs import ExplorationType, RewardScaling, set_exploration_type

from locomotion import train
from locomotion.agents.architectures import Network
from locomotion.envs import LocomotionEnv
from locomotion.options import ConfigError
from locomotion.training.build import make_learner

pytestmark = pytest.mark.slow


@pytest.fixture
def kept(keeping):
    """Makes the configured learner, and keeps what it learns from: ``kept(config, in_keys).last``."""

    class Kept:
        def __call__(self, config, in_keys=None, network=None):
            def learner(env):
                self.last = keeping(make_learner(config, env, in_keys, network))
                return self.last

            return learner

        @property
        def batch(self):
            return torch.cat(self.last.batches, 1)

    return Kept()


class Jumping(LocomotionEnv):
    """Pays for the height of the core, and counts how often it was asked to."""

    def reward(self, before, after):
        self.asked = getattr(self, "asked", 0) + 1
        return after.field("qpos")[:, 2] - 2 * before.field("qpos")[:, 2]


def test_a_reward_of_ones_own_is_what_is_learned_from(
    configured, kept, rows, stepped_by_hand, tmp_path
):
    readings = ["hinge_position", "core_orientation", "core_height"]
    env = Jumping("gecko", 5, readings=readings, seed=0, time_limit=2, physics={"threads": 1})
    config = configured("env.time_limit=2")
    scaled = RewardScaling(0.0, 10.0)
    result = train(config, tmp_path / "run", env=env, transforms=[scaled], learner=kept(config))
    before, after = stepped_by_hand(kept.batch["action"], 2, readings=readings)
    expected = 10 * (after["core_height"] - 2 * before["core_height"])
    torch.testing.assert_close(kept.batch["next", "reward"], expected)
    found = [row["mean_reward"] for row in rows(result.folder)]
    expected = [part.mean().item() for part in expected.split(12, 1)]
    assert found == pytest.approx(expected, rel=1e-5)
    assert result.reward == pytest.approx(sum(expected) / 3, rel=1e-5)
    assert env.asked == 36


def test_an_environment_that_was_passed_is_left_open(configured, tmp_path):
    env = LocomotionEnv("gecko", 5, seed=0, physics={"threads": 1})
    train(configured(), tmp_path / "run", env=env)
    assert env.rollout(3).shape == (5, 3)


class Joined(nn.Module):
    """A linear layer for all observations."""

    def __init__(self, in_features, out_features):
        super().__init__()
        self.layer = nn.Linear(in_features, out_features)

    def forward(self, *seen):
        return self.layer(torch.cat(seen, -1))


@dataclasses.dataclass
class Linear(Network):
    """No hidden layers at all."""

    def make_network(self, sizes, out_features):
        joined = Joined(sum(sizes.values()), out_features)
        return TensorDictModule(joined, list(sizes), ["loc"])

    def make_critic(self, sizes):
        return TensorDictModule(Joined(sum(sizes.values()), 1), list(sizes), ["state_value"])


def test_a_network_of_ones_own_is_the_policy(configured, kept, rows, tmp_path):
    config = configured("+obs=history3")
    network = Linear(initial_deviation=0.2)
    learner = kept(config, network=network)
    result = train(config, tmp_path / "run", network=network, learner=learner)
    policy, batch = kept.last.policy, kept.last.batches[0]
    assert sum(parameter.numel() for parameter in policy.parameters()) == (3 * 6 + 4) * 6 + 6 + 6
    torch.testing.assert_close(batch["scale"], torch.full((5, 12, 6), 0.2))
    # The mean is a linear function of what is seen.
    seen = torch.cat([batch["hinge_position_history"], batch["core_orientation"]], -1)
    seen = torch.cat([seen, torch.ones(5, 12, 1)], -1).flatten(0, 1)
    mean = batch["loc"].flatten(0, 1)
    weights = torch.linalg.lstsq(seen.double(), mean.double(), driver="gelsd").solution
    torch.testing.assert_close(seen.double() @ weights, mean.double(), rtol=1e-3, atol=1e-4)
    assert len(rows(result.folder)) == 3
    # Without the learner that keeps batches it is the same run.
    again = train(config, tmp_path / "again", network=Linear(initial_deviation=0.2))
    assert rows(again.folder) == rows(result.folder)


class Supervised:
    """A learner that knows the best action, and says nothing about values."""

    def __init__(self, env):
        size, hinges = env.observation_spec["target"].shape[-1], env.action_spec.shape[-1]
        self.policy = TensorDictModule(nn.Linear(size, hinges), ["target"], ["action"])
        self.optimizer = torch.optim.Adam(self.policy.parameters(), lr=0.1)
        self.updates = 0

    def update(self, batch):
        self.updates += 1
        with torch.enable_grad():
            error = self.policy(batch.select("target"))["action"] - batch["target"]
            loss = error.square().mean()
            self.optimizer.zero_grad()
            loss.backward()
            self.optimizer.step()
        return {"squared_error": loss.item(), "updates": self.updates}

    def state_dict(self):
        return {"optimizer": self.optimizer.state_dict(), "updates": self.updates}

    def load_state_dict(self, state_dict):
        self.optimizer.load_state_dict(state_dict["optimizer"])
        self.updates = state_dict["updates"]


def test_a_learner_of_ones_own_decides_what_is_learned_and_reported(
    configured, target_env, rows, tmp_path
):
    config = configured("ppo.iterations=60", "checkpoint_interval=7")
    result = train(config, tmp_path / "run", env=target_env(5), learner=Supervised)
    found = rows(result.folder)
    names = ["iteration", "frames", "mean_reward", "mean_value", "squared_error", "updates"]
    assert list(found[0])[:6] == names
    assert [row["updates"] for row in found] == list(range(1, 61))
    assert found[0]["squared_error"] > 0.1 and found[-1]["squared_error"] < 1e-3
    assert found[0]["mean_reward"] < -0.1 and result.reward > -0.01
    assert found[0]["mean_value"] != found[0]["mean_value"]  # it has none


def test_a_learner_of_ones_own_goes_on_from_its_state(configured, target_env, rows, tmp_path):
    config = configured("ppo.iterations=9", "checkpoint_interval=3")
    whole = train(config, tmp_path / "whole", env=target_env(5), learner=Supervised)

    def stop(row):
        if row["iteration"] == 4:
            raise RuntimeError("stopped by hand")

    passed = {"env": target_env(5), "learner": Supervised}
    with pytest.raises(RuntimeError, match="stopped by hand"):
        train(config, tmp_path / "run", **passed, callbacks=[stop])
    assert len(rows(tmp_path / "run")) == 5
    passed["env"] = target_env(5)
    assert train(config, tmp_path / "run", **passed).reward == whole.reward
    assert str(rows(tmp_path / "run")) == str(rows(whole.folder))  # in which nan equals nan


def test_callbacks_see_each_row_after_it_was_written(configured, rows, tmp_path):
    seen, written = [], []
    callbacks = [seen.append, lambda row: written.append(rows(tmp_path / "run"))]
    result = train(configured(), tmp_path / "run", callbacks=callbacks)
    found = rows(result.folder)
    assert [len(part) for part in written] == [1, 2, 3]
    for row, known in zip(found, seen, strict=True):
        assert {"collect_seconds", "update_seconds"} == known.keys() - row.keys()
        assert row == pytest.approx({key: known[key] for key in row}, rel=1e-6)
    # They change nothing.
    assert rows(train(configured(), tmp_path / "again").folder) == found


def deterministic_error(learner, batch, target):
    with set_exploration_type(ExplorationType.DETERMINISTIC), torch.no_grad():
        return (learner.policy(batch.clone())["action"] - target).abs().mean().item()


def test_what_is_best_is_found(configured, kept, target_env, tmp_path):
    config = configured(
        "env.num_envs=32",
        *("ppo.iterations=40", "ppo.steps=32", "ppo.minibatch_size=256", "ppo.gamma=0"),
        *("ppo.actor_lr=5e-3", "ppo.critic_lr=5e-3"),
    )
    learner = kept(config, ["target"])
    result = train(
        config, tmp_path / "run", env=target_env(32), in_keys=["target"], learner=learner
    )
    batch = kept.last.batches[-1]
    assert deterministic_error(kept.last, batch, batch["target"]) < 0.05
    assert result.reward > -0.3


@pytest.mark.parametrize("network", ["mlp", "gru"])
def test_what_has_to_be_remembered_is_found_by_a_policy_with_a_memory(
    configured, kept, target_env, tmp_path, network
):
    config = configured(
        "env.num_envs=64",
        *("ppo.iterations=30", "ppo.steps=8", "ppo.minibatch_size=128", "ppo.gamma=0"),
        *("ppo.actor_lr=5e-3", "ppo.critic_lr=5e-3", "ppo.max_grad_norm=0.5"),
        f"network={network}",
    )
    train(config, tmp_path / "run", env=target_env(64, 4, True), learner=kept(config, ["target"]))
    batch = kept.last.batches[-1]
    # Episodes of four steps, of which the first one shows the target.
    target = batch["target"][:, [0, 0, 0, 0, 4, 4, 4, 4]]
    assert (batch["target"] == target).all(-1)[:, [0, 4]].all()
    error = (batch["loc"] - target).abs().mean(-1)[:, [1, 2, 3, 5, 6, 7]].mean()
    assert (error < 0.06) == (network == "gru")
    assert error < 0.3  # a quarter is what it takes to always aim for the middle


def test_what_was_passed_belongs_to_the_run(configured, target_env, tmp_path):
    config = configured()
    train(config, tmp_path / "run", env=target_env(5), learner=Supervised)
    again = train(config, tmp_path / "run", env=target_env(5), learner=Supervised)
    assert again.skipped
    with pytest.raises(ValueError, match=r"holds a run with .*Supervised"):
        train(config, tmp_path / "run", env=target_env(5), in_keys=["target"])


def test_in_keys_that_do_not_fit_are_named(configured, target_env, tmp_path):
    with pytest.raises(ConfigError, match="'hinge_position', but the environment writes target"):
        train(configured(), tmp_path / "run", env=target_env(5))
