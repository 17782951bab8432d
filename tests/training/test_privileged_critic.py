"""A critic that sees more than the policy does."""

import pytest
import torch

from locomotion import train
from locomotion.config import typed_config
from locomotion.options import ConfigError
from locomotion.training.build import make_env, make_learner

pytestmark = pytest.mark.slow


def test_the_critic_alone_sees_its_terms(configured):
    config = configured("+obs=history3", "critic=privileged")
    env = make_env(config)
    learner = make_learner(config, env)
    seen = ["hinge_position_history", "core_orientation"]
    assert learner.policy.in_keys == seen
    more = {"critic_hinge_velocity_scaled", "core_linear_velocity", "core_height", "course"}
    assert more < {*learner.critic.in_keys} - {*seen}
    batch = env.rollout(3, learner.policy)
    value = learner.critic(batch.clone())["state_value"]
    moved = learner.critic(batch.clone().set("course", -batch["course"]))["state_value"]
    assert (value != moved).any()
    env.close()


def test_terms_of_one_name_differ_between_policy_and_critic(configured):
    config = configured("+critic.hinge_position={steps: 2, scale: 3.0}")
    env = make_env(config)
    batch = env.rollout(4, make_learner(config, env).policy)
    expected = torch.cat([batch["hinge_position"][:, 1:], batch["hinge_position"][:, :-1]], -1)
    torch.testing.assert_close(batch["critic_hinge_position_history"][:, 1:], 3 * expected)
    env.close()


def test_a_run_with_it_resumes_bit_for_bit(configured, rows, tmp_path):
    class Lost(Exception):
        """The end of a machine."""

    def lose(row):
        if row["iteration"] == 1:
            raise Lost

    config = configured("critic=privileged", "checkpoint_interval=1")
    train(config, tmp_path / "whole")
    with pytest.raises(Lost):
        train(config, tmp_path / "parts", callbacks=[lose])
    train(config, tmp_path / "parts")
    assert rows(tmp_path / "parts") == rows(tmp_path / "whole")


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("+critic.smell={}", "critic.smell.reading=smell is unknown"),
        ("+critic.course={step: 2}", "critic.course.step is not a key; did you mean"),
        ("+critic.core_height={representation: yaw}", "critic.core_height.representation=yaw"),
    ],
)
def test_a_term_that_cannot_be_is_refused_by_name(configured, override, words):
    with pytest.raises(ConfigError, match=words):
        typed_config(configured(override))
