"""``compose``: the configuration that a command line stands for, in any program."""

import importlib
import subprocess
import sys
import textwrap

import hydra
import pytest
from hydra import version
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig

from locomotion import compose
from locomotion.config import as_dict
from locomotion.envs.observations import ObsTerm, Representation
from locomotion.options import ConfigError


def test_defaults_are_the_reports():
    config = compose()
    learner = config.learner
    assert (config.robot.name, config.algorithm, config.network["name"]) == ("gecko", "ppo", "mlp")
    assert (config.env.num_envs, learner.steps, learner.iterations) == (64, 128, 200)
    assert (learner.epochs, learner.minibatch_size) == (4, 2048)
    assert (learner.actor_lr, learner.critic_lr) == (0.0008, 0.001)
    assert (learner.gamma, learner.gae_lambda, learner.clip_epsilon) == (0.99, 0.95, 0.2)
    assert (learner.entropy_coeff, config.env.control_frequency) == (0.01, 4.0)
    assert config.task.rewards == {"distance": {"weight": 1.0}}
    assert config.obs == compose("obs=hinges_orientation").obs


@pytest.mark.parametrize(
    ("name", "terms"),
    [
        ("hinges", {"hinge_position": ObsTerm()}),
        ("history3_hinges", {"hinge_position": ObsTerm(steps=3)}),
        (
            "history3",
            {
                "hinge_position": ObsTerm(steps=3),
                "core_orientation": ObsTerm(representation=Representation.quaternion),
            },
        ),
    ],
)
def test_observations_are_chosen_with_and_without_a_plus(name, terms):
    assert compose(f"obs={name}").obs == compose(f"+obs={name}").obs == terms


def test_terms_are_changed_added_and_removed_by_their_keys():
    terms = compose(
        "obs.hinge_position.steps=5",
        "obs.core_orientation.representation=gravity",
        "obs.hinge_velocity.scale=0.1",
        "+obs.speed.reading=core_linear_velocity",
        "+obs.core_height={}",
    ).obs
    assert terms == {
        "hinge_position": ObsTerm(steps=5),
        "core_orientation": ObsTerm(representation=Representation.gravity),
        "hinge_velocity": ObsTerm(scale=0.1),
        "speed": ObsTerm(reading="core_linear_velocity"),
        "core_height": ObsTerm(),
    }
    assert [*compose("~obs.core_orientation").obs] == ["hinge_position"]


@pytest.mark.slow
def test_every_choice_composes():
    for override in (
        *("robot=ant", "task=turn", "task=walk_along", "physics=warp", "network=gru"),
        *("logger=tensorboard", "+experiment=quick", "+experiment=gpu", "arena=ground"),
    ):
        compose(override)
    assert compose("network=gru").network["hidden_size"] == 64
    assert compose("task=walk_along").task.rewards.keys() == {"velocity", "work"}


def test_settings_for_a_gpu_are_for_one():
    config = compose("+experiment=gpu")
    assert (config.physics.device, config.env.num_envs) == ("cuda:0", 4096)
    assert config.env.num_envs * config.learner.steps % config.learner.minibatch_size == 0


def test_a_mistake_is_one_line_and_the_next_call_is_as_ever():
    before = compose()
    with pytest.raises(ConfigError, match="^ppo.iteration is not a key; did you mean ppo.iter"):
        compose("ppo.iteration=3")
    with pytest.raises(ConfigError, match="^seed=1,2: several values need --multirun$|seed=1,2"):
        compose("seed=1,2")
    assert compose() == before
    assert as_dict(compose("seed=3")) == {**as_dict(before), "seed": 3}


def test_choices_of_ones_own_are_in_a_folder(tmp_path):
    (tmp_path / "task").mkdir()
    (tmp_path / "task" / "mine.yaml").write_text("rewards: {velocity: {direction: 1}, work: }\n")
    config = compose("task=mine", config_dir=tmp_path)
    assert config.task.rewards == {
        "velocity": {"weight": 1.0, "direction": 1.0},
        "work": {"weight": -0.01},
    }
    with pytest.raises(ConfigError, match="task=mine is unknown; choose from turn"):
        compose("task=mine")


@pytest.mark.filterwarnings("ignore:(?s).*selects Hydra 1.1 compatibility")
def test_another_hydra_application_is_left_as_it_is(tmp_path):
    (tmp_path / "theirs.yaml").write_text("defaults: [{part: one}, _self_]\nvalue: 3\n")
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "one.yaml").write_text("key: 1\n")
    with hydra.initialize_config_dir(str(tmp_path), version_base="1.1", job_name="theirs"):
        theirs = hydra.compose("theirs", return_hydra_config=True)
        base, place = version.getbase(), GlobalHydra.instance().config_loader().get_search_path()
        config = compose("robot=ant", "seed=4")
        with pytest.raises(ConfigError):
            compose("robot=lizard")
        assert (config.robot.name, config.seed) == ("ant", 4)
        assert str(version.getbase()) == str(base) == "1.1"
        after = GlobalHydra.instance().config_loader().get_search_path()
        assert str(after) == str(place)
        assert hydra.compose("theirs") == {"part": {"key": 1}, "value": 3}
        assert theirs.hydra.job.name == "theirs"
    assert not GlobalHydra.instance().is_initialized()
    compose()
    assert not GlobalHydra.instance().is_initialized()
    assert not HydraConfig.initialized()
    version.setbase("1.2")
    compose()
    assert str(version.getbase()) == "1.2"


HOST = textwrap.dedent(
    """
    import dataclasses

    import hydra
    from hydra import version
    from hydra.core.config_store import ConfigStore
    from hydra.core.hydra_config import HydraConfig

    from locomotion import compose, train


    @dataclasses.dataclass
    class Schema:
        robot: str = "ant"
        seed: int = 0


    for name in ("schema", "config"):  # names that others use too
        ConfigStore.instance().store(name, Schema)


    @hydra.main(version_base="1.2", config_path=None, config_name="config")
    def main(theirs):
        small = ["env.num_envs=3", "ppo.steps=4", "ppo.minibatch_size=6", "ppo.iterations=2"]
        result = train(compose(f"robot={theirs.robot}", f"seed={theirs.seed}", *small), "run")
        again = compose("+obs=history3")
        print(result.folder, result.reward > -1, again.robot.name, version.getbase())
        print(HydraConfig.get().job.name, HydraConfig.get().job.num, theirs)


    main()
    """
)


@pytest.mark.slow
def test_it_trains_inside_somebody_elses_sweep(tmp_path):
    (tmp_path / "host.py").write_text(HOST)
    command = [sys.executable, "host.py", "--multirun", "seed=5,6", "hydra.job.chdir=true"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stderr
    shown = [line for line in result.stdout.splitlines() if not line.startswith("[")]
    assert shown == [
        "run True gecko 1.2",
        "host 0 {'robot': 'ant', 'seed': 5}",
        "run True gecko 1.2",
        "host 1 {'robot': 'ant', 'seed': 6}",
    ]
    assert len(list(tmp_path.glob("multirun/*/*/*/run/metrics.csv"))) == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    "module",
    ["envs.readings", "tasks.rewards", "arenas.choices", "agents.learners", "cli.composing"],
)
def test_modules_can_be_reloaded(module):
    # As in a notebook, where a cell reloads what was edited. In a process of its own, as classes change.
    code = (
        f"import importlib, locomotion.{module} as module; from locomotion import compose;"
        "compose('+obs=history3'); importlib.reload(module); print(compose('robot=ant').robot.name)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout == "ant\n", result.stderr


def test_the_module_train_is_the_function_too():
    import locomotion

    importlib.import_module("locomotion.train")
    with pytest.raises(TypeError, match="config"):
        locomotion.train()
