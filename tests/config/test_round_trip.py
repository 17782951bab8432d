"""A run's record of its configuration is that configuration."""

import tempfile
from pathlib import Path

import pytest
import yaml
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from locomotion import compose
from locomotion.config import as_dict, typed_config
from locomotion.options import ConfigError, choices
from locomotion.runs import differences, read_config, record

pytestmark = pytest.mark.slow

GROUPS = ("robot", "obs", "arena", "task", "physics", "algorithm", "network", "logger")


def assert_same(config, other):
    assert config == other
    assert config.learner == other.learner
    assert config.architecture == other.architecture


def assert_round_trip(config):
    content = as_dict(config)
    assert yaml.safe_load(yaml.safe_dump(content)) == content  # plain values alone
    assert_same(typed_config(content), config)
    assert as_dict(typed_config(content)) == content
    with tempfile.TemporaryDirectory() as folder:
        record(Path(folder), config=content)
        assert_same(typed_config(read_config(Path(folder))), config)
        assert differences(Path(folder), config) == {}


@pytest.mark.parametrize(
    "choice", [f"{group}={name}" for group in GROUPS for name in choices(group)]
)
def test_every_choice_is_recorded(choice):
    try:
        config = compose(choice)
    except ConfigError as error:  # packages that are not installed here
        pytest.skip(str(error))
    assert_round_trip(config)


positive = st.floats(1e-3, 1.0)


@st.composite
def overrides(draw):
    """Some overrides, each of a valid value, that can go together."""
    numbers = {
        "seed": st.integers(0, 2**31 - 1),
        "env.num_envs": st.integers(64, 4096),
        "env.settle_time": st.floats(0, 10),
        "env.target_limit": positive,
        "env.time_limit": st.one_of(st.just("null"), st.floats(1, 1e6)),
        "physics.friction": st.floats(0, 10),
        "disturbances.latency": st.floats(0, 1),
        "physics.self_collision": st.sampled_from(["true", "false"]),
        "ppo.gamma": st.floats(0, 1),
        "ppo.actor_lr": st.floats(1e-6, 1),
        "ppo.epochs": st.integers(1, 50),
        "ppo.optimizer": st.sampled_from(["adam", "adamw", "rmsprop", "sgd"]),
        "ppo.schedule": st.sampled_from(["linear", "constant"]),
        "ppo.optimizer_options": st.sampled_from(
            ["{}", "{weight_decay: 0.1}", "{betas: [0, 0.9]}"]
        ),
        "ppo.max_grad_norm": st.one_of(st.just("null"), positive),
        "network.hidden": st.lists(st.integers(1, 64), min_size=1, max_size=3),
        "task.rewards.velocity.direction": st.floats(-3, 3),
        "task.rewards.work.weight": st.floats(-1, 0),
        "obs.hinge_position.steps": st.integers(1, 9),
        "obs.hinge_velocity.scale": positive,
        "obs.core_orientation.representation": st.sampled_from(
            ["quaternion", "rotation_6d", "gravity", "yaw", "null"]
        ),
        "obs.sight.reading": st.sampled_from(["core_height", "phase_clock", "ground_contact"]),
        "ppo.optimizer_options.eps": st.floats(1e-8, 1e-3),
        "+robot.body.children.front.module": st.just("hinge"),
        "checkpoint_interval": st.integers(1, 1000),
    }
    keys = draw(st.lists(st.sampled_from(sorted(numbers)), unique=True, max_size=8))
    robot = draw(st.sampled_from(["gecko", "ant"]))
    return [f"robot={robot}", *(f"{key}={draw(numbers[key])}" for key in keys)]


# Without shrinking: composing takes a tenth of a second, and a few overrides are read at once.
@settings(max_examples=10, deadline=None, phases=(Phase.explicit, Phase.reuse, Phase.generate))
@given(overrides())
def test_any_configuration_is_recorded(lines):
    assert_round_trip(compose(*lines))


def test_what_is_recorded_does_not_hang_on_the_order_of_overrides():
    lines = ["seed=3", "obs=history3", "network=gru", "ppo.gamma=0.9", "physics.friction=0.5"]
    assert as_dict(compose(*lines)) == as_dict(compose(*reversed(lines)))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"algorithm": None}, "algorithm=None is unknown; choose from cpg, ppo"),
        ({"ppo": 3}, "ppo=3 must be keys and values"),
        ({"ppo": [1]}, r"ppo=\[1\] must be keys and values"),
        ({"obs": {"hinge_position": 3}}, "obs.hinge_position=3 must be keys and values"),
        ({"obs": {}}, "obs has no term"),
        ({"network": {"name": ["mlp"]}}, r"network.name=\['mlp'\] is unknown"),
        ({"network": {}}, "network.name is missing; choose from gru, mlp"),
        ({"task": {"rewards": [1]}}, "task.rewards|Dict"),
        ({"task": {"rewards": {"work": [1]}}}, r"task.rewards.work=\[1\] must be keys and values"),
        ({3: 4}, "3 is not a key"),
        ({"plugins": "os"}, "plugins"),
        ({"plugins": ["no_such_module"]}, "plugins=no_such_module has not been imported"),
        ({"robot": None}, "robot"),
    ],
)
def test_a_record_that_somebody_changed_is_refused_in_words(changed, message):
    with pytest.raises(ConfigError, match=message) as refusal:
        typed_config({**as_dict(compose()), **changed})
    assert "\n" not in str(refusal.value)


def test_keys_of_a_learner_that_is_not_asked_for_are_left_out():
    config = typed_config({**as_dict(compose()), "ppo": {"gamma": 0.9}})
    assert config.learner.gamma == 0.9
    assert config.learner.epochs == 4
