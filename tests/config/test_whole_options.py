"""Options of a run are whole, and copies of a run keep them."""

import copy
import dataclasses
import pickle

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from locomotion import compose
from locomotion.agents.architectures import Network
from locomotion.agents.base import LearnerConfig
from locomotion.config import all_keys, as_dict, free_keys
from locomotion.options import ConfigError, choices, key, learners, networks
from locomotion.runs import differences, record

pytestmark = pytest.mark.slow

COPIES = {
    "replace": lambda config: dataclasses.replace(config, seed=config.seed),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda config: pickle.loads(pickle.dumps(config)),
}


@pytest.mark.parametrize("make", COPIES.values(), ids=COPIES)
def test_a_copy_has_the_learner_and_the_network_of_the_original(make):
    config = compose("ppo.gamma=0.5", "network=gru", "network.hidden_size=3", "seed=2")
    other = make(config)
    assert other == config
    assert (other.learner.gamma, other.architecture.hidden_size) == (0.5, 3)
    assert as_dict(other) == as_dict(config)


def test_runs_of_other_learner_options_are_not_equal():
    config = compose()
    learner = dataclasses.replace(config.learner, gamma=0.5)
    assert dataclasses.replace(config, learner=learner) != config
    assert dataclasses.replace(config, network={"name": "gru"}).architecture.layers == 1


def test_the_learner_is_no_key_of_its_own():
    assert "learner" not in as_dict(compose())
    with pytest.raises(ConfigError, match="^learner is not a key"):
        compose("learner.gamma=0.5")


@dataclasses.dataclass
class Other(LearnerConfig):
    PREFIX = "other."
    shown: int = key("what is shown", default=0, free=True)


@dataclasses.dataclass
class Plain(Network):
    shown: int = key("what is shown", default=0, free=True)
    width: int = key("free here, but not in another network", default=1, free=True)


def test_a_key_of_any_part_can_leave_the_numbers_alone(tmp_path):
    learners.register("other")(Other)
    networks.register("plain")(Plain)
    assert {"other.shown", "network.shown", "physics.threads"} <= free_keys()
    assert "network.width" not in free_keys()
    config = compose("algorithm=ppo", "network=mlp")
    content = {**as_dict(config), "network": {**config.network, "shown": 1}}
    record(tmp_path, config=content)
    assert differences(tmp_path, config) == {}


@pytest.mark.parametrize(
    ("group", "part"), [("network", "network"), ("arena", "arena"), ("task", "task")]
)
def test_what_a_file_leaves_out_is_filled_up(group, part):
    known = {name for name, _ in all_keys()}
    for name in choices(group):
        values = as_dict(compose(f"{group}={name}"))[part]
        if group == "task":
            for reward, options in values["rewards"].items():
                wanted = {x for x in known if x.startswith(f"task.rewards.{reward}.")}
                assert {f"task.rewards.{reward}.{key}" for key in options} == wanted
        else:
            assert {f"{part}.{key}" for key in values} <= {*known, f"{part}.name"}
    assert as_dict(compose())["network"] == {
        "name": "mlp",
        "width": 32,
        "hidden": [32],
        "initial_deviation": 1.0,
        "initial_gain": 1.0,
    }


@settings(max_examples=5, deadline=None)
@given(st.integers(1, 99))
def test_keys_that_no_file_holds_can_be_set(width):
    config = compose(f"network.width={width}")
    assert config.architecture.width == config.network["width"] == width


def test_a_misspelt_key_is_refused_with_the_one_that_was_meant():
    for wrong, meant in (
        ("network.widht=3", "network.widht is not a key; did you mean network.width?"),
        ("task.rewards.distance.wieght=3", "did you mean task.rewards.distance.weight?"),
        ("arena.nmae=3", "arena.nmae is not a key"),
    ):
        with pytest.raises(ConfigError) as refused:
            compose(wrong)
        assert meant in str(refused.value)
