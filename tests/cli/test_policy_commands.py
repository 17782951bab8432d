"""The command lines of evaluate, watch and export: what they print, and what they refuse."""

import json
import shutil
import sys

import pytest
import torch
from omegaconf import OmegaConf

from locomotion import compose, evaluate, export, watch
from locomotion.cli.composing import amended, parse
from locomotion.config import typed_config
from locomotion.evaluation import make_runner, measure, walk
from locomotion.evaluation.shipped import POLICIES, shipped
from locomotion.physics.options import PhysicsConfig
from locomotion.runs import read_config
from locomotion.runs.checkpoints import Checkpoints
from locomotion.training.build import make_env, make_learner
from locomotion.training.execute import execute

pytestmark = pytest.mark.slow

COMMANDS = {"evaluate": evaluate, "watch": watch, "export": export}


@pytest.fixture
def call(monkeypatch, capsys):
    """Calls a command in this process; gives what it prints on standard output."""

    def called(name, *arguments):
        monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        COMMANDS[name].COMMAND.main()
        return capsys.readouterr().out

    return called


@pytest.fixture
def refused(call, capsys):
    """Calls a command that refuses its arguments; gives the line."""

    def line(name, *arguments):
        with pytest.raises(SystemExit) as ended:
            call(name, *arguments)
        printed = capsys.readouterr()
        assert ended.value.code == 2
        assert printed.out == ""
        assert printed.err.startswith("error: ")
        assert printed.err.count("\n") == 1
        return printed.err.removeprefix("error: ").rstrip()

    return line


def strictly(text):
    """JSON without nan and infinity, which are no part of it."""

    def refuse(constant):
        raise ValueError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def test_json_is_all_that_is_on_standard_output(command, tmp_path):
    task = ("robot=ant", "physics.friction=0.8", "disturbances.latency=0.1", "arena=ground")
    result = command("evaluate", "seconds=1", "env.num_envs=3", "json=true", *task, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    found = strictly(result.stdout)
    assert (found["robot"], found["robots"], found["seconds"]) == ("ant", 3, 1.0)
    for how in ("mean_action", "sampled"):
        assert found[how]["speed"]["low"] < found[how]["speed"]["mean"]
        assert set(found[how]["on_back"]) == {"mean", "low", "high"}

    saved = OmegaConf.load(POLICIES / "ant" / ".hydra" / "config.yaml")
    saved.env.num_envs = 3
    saved.physics.friction = 0.8
    saved.disturbances = {"latency": 0.1}
    runner = make_runner(POLICIES / "ant", typed_config(saved, learning=False))
    speed = measure(walk(runner, 1.0))["speed"].mean().item()
    assert found["mean_action"]["speed"]["mean"] == pytest.approx(speed, abs=1e-9)


def test_json_has_null_for_what_is_unknown(call):
    unstable = ("physics.timestep=0.25", "physics.stiffness=1000", "seconds=1")
    found = strictly(
        call("evaluate", "json=true", "reality_check=true", "env.num_envs=2", *unstable)
    )
    assert found["mean_action"]["diverged"]["mean"] == 1
    assert set(found["mean_action"]["speed"].values()) == {None}
    finer = next(
        row for row in found["reality_check"] if row["override"] == "physics.timestep=0.025"
    )
    assert finer["speed"] > 0
    assert finer["share"] == {"mean": None, "low": None, "high": None}


def test_the_table_names_every_measure_and_one_robot_has_no_interval(call):
    table = call("evaluate", "seconds=1", "env.num_envs=1", "reality_check=true")
    for words in ("speed (m/s)", "heading drift (°/min)", "work per metre (J/m)", "on back"):
        assert words in table
    for words in ("physics.timestep=0.001", "disturbances.latency=0.25", "disturbances.push=0.5"):
        assert words in table
    assert "nan" not in table
    (speed,) = (line for line in table.splitlines() if line.startswith("speed"))
    assert "[" not in speed


def test_a_policy_is_measured_without_the_disturbances_of_its_training(call, tmp_path):
    shutil.copytree(POLICIES / "gecko", tmp_path / "run")
    record = tmp_path / "run" / ".hydra" / "config.yaml"
    saved = OmegaConf.load(record)
    saved.disturbances = {"latency": [0.1, 0.25], "mass": 2.0}
    OmegaConf.save(saved, record)
    short = (f"run={tmp_path / 'run'}", "seconds=2", "env.num_envs=2", "json=true")
    plain, trained, late = (
        strictly(call("evaluate", *words))["mean_action"]["speed"]["mean"]
        for words in (short[1:], short, (*short, "disturbances=robust", "disturbances.chance=1"))
    )
    assert plain == trained != late


def test_the_film_and_the_table_say_the_same_speed(call, tmp_path):
    said = call("watch", "seconds=2", "web=true", f"output={tmp_path / 'gait.html'}")
    found = strictly(call("evaluate", "seconds=2", "env.num_envs=1", "json=true"))["mean_action"]
    speed, distance = found["speed"]["mean"], found["distance"]["mean"]
    assert said.startswith(f"gecko walks {distance:.2f} m from its start in 2 s, {speed:.2f} m/s:")


@pytest.mark.parametrize("name", COMMANDS)
def test_help_names_every_key(name, call):
    text = call(name, "--help")
    for key in ("robot", "run", "plugins", "arena", "physics", "physics.self_collision", "seed"):
        assert f"\n  {key} " in text
    assert ", ".join(shipped()) in text
    assert ("env.num_envs" in text) == (name == "evaluate")
    assert "env.time_limit" not in text
    assert ("reality_check" in text) == (name == "evaluate")


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("evaluate", ["robot=lizard"], "robot=lizard has no policy that ships; choose from ant"),
        ("evaluate", ["robot=ant", "run=x"], "robot=ant and run=x name two policies"),
        ("evaluate", ["run=nowhere"], "nowhere holds no .hydra/config.yaml"),
        ("evaluate", ["secnds=3"], "secnds is not a key; did you mean seconds?"),
        ("evaluate", ["latency=1"], "latency is not a key; did you mean disturbances.latency?"),
        ("evaluate", ["seconds=0"], "seconds=0.0 must be above 0"),
        ("evaluate", ["seconds=soon"], "seconds"),
        ("evaluate", ["delay=1"], "delay is not a key; allowed are"),
        (
            "evaluate",
            ["disturbances.hinge_noise=nan"],
            "disturbances.hinge_noise=nan must be at least 0",
        ),
        ("evaluate", ["json=perhaps"], "json: Value 'perhaps' is not a valid bool"),
        ("evaluate", ["physics.fiction=1"], "physics.fiction is not a key; did you mean"),
        ("evaluate", ["physics.friction=-1"], "physics.friction=-1.0 must be at least 0"),
        ("evaluate", ["disturbances.latency=-1"], "disturbances.latency=-1.0 must be at least 0"),
        ("evaluate", ["physics=bullet"], "physics=bullet is unknown; choose from"),
        ("evaluate", ["arena=moon"], "arena=moon is unknown; choose from ground"),
        ("evaluate", ["arena.name=moon"], "arena.name=moon is unknown; choose from"),
        ("evaluate", ["+plugins=[no_such_module]"], "plugins=no_such_module cannot be imported"),
        ("evaluate", ["env.num_envs=0"], "env.num_envs=0 must be at least 1"),
        ("evaluate", ["env.time_limit=3"], "env.time_limit is null in this command"),
        ("watch", ["env.stagger=true"], "env.stagger is false in this command"),
        ("evaluate", ["env.control_frequency=3"], "must divide the control period"),
        ("evaluate", ["ppo.epochs=3"], "ppo.epochs is settled by training"),
        ("evaluate", ["network=gru"], "network is settled by training"),
        ("evaluate", ["+obs=history3"], "obs is settled by training"),
        ("evaluate", ["robot.body.module=brick"], "robot.body.module is settled by training"),
        ("evaluate", ["physics.friction=1,2"], "physics.friction=1,2 has no meaning for a policy"),
        ("evaluate", ["~physics"], "~physics has no meaning"),
        ("evaluate", ["hydra.run.dir=x"], "hydra.run.dir=x has no meaning"),
        ("evaluate", ["--multirun"], "--multirun is not a flag of this command"),
        ("evaluate", ["gecko"], "gecko is not KEY=VALUE"),
        (
            "evaluate",
            ["disturbances.latency=9.9", "reality_check=true"],
            "disturbances.latency=10.15 must be at least 0 and at most 10",
        ),
        ("watch", ["env.num_envs=3"], "env.num_envs is 1 in this command"),
        ("watch", ["output=film.avi"], "output=film.avi must be a file that ends in .mp4"),
        ("watch", ["web=true", "output=a.mp4"], "output=a.mp4 must be a file that ends in .html"),
        ("watch", ["web=true", "live=true"], "live=true must be false with web=true"),
        ("watch", ["width=801"], "width=801 height=450 must be even"),
        ("watch", ["fps=0"], "fps=0 must be at least 1"),
        ("watch", ["output=/proc/x.mp4"], "/proc cannot be written"),
        ("export", ["output=gait.bin"], "output=gait.bin must be a file that ends in .onnx"),
        ("export", ["seconds=3"], "seconds is not a key"),
        ("export", ["output=nowhere/x.onnx"], "output=nowhere/x.onnx: there is no folder nowhere"),
    ],
)
def test_a_wrong_call_is_answered_in_one_line(name, arguments, message, refused):
    assert message in refused(name, *arguments)


def test_without_onnx_the_line_says_what_to_install(refused, monkeypatch, tmp_path):
    found = export.importlib.util.find_spec
    monkeypatch.setattr(
        export.importlib.util, "find_spec", lambda name: None if name == "onnx" else found(name)
    )
    monkeypatch.chdir(tmp_path)
    assert "pip install onnx onnxscript" in refused("export")
    assert not list(tmp_path.iterdir())


def test_a_run_without_a_checkpoint_or_with_a_broken_policy_is_named(refused, tmp_path):
    shutil.copytree(POLICIES / "gecko" / ".hydra", tmp_path / ".hydra")
    for name in COMMANDS:
        assert refused(name, f"run={tmp_path}") == f"{tmp_path} holds no checkpoint yet"

    config = typed_config(OmegaConf.load(tmp_path / ".hydra" / "config.yaml"), learning=False)
    policy = make_learner(config, make_env(config)).policy
    next(policy.parameters()).data.fill_(torch.nan)
    path = Checkpoints(tmp_path, policy=policy).save(7)
    for name in COMMANDS:
        assert refused(name, f"run={tmp_path}").startswith(f"{path} holds a policy with weights")


def test_a_folder_of_another_project_is_refused(refused, tmp_path):
    (tmp_path / ".hydra").mkdir()
    (tmp_path / ".hydra" / "config.yaml").write_text("learning_rate: 3\n")
    assert "holds no run of this project" in refused("evaluate", f"run={tmp_path}")


def test_a_logger_of_the_run_need_not_be_installed(call, tmp_path, monkeypatch):
    run = shutil.copytree(POLICIES / "gecko", tmp_path / "run")
    saved = OmegaConf.load(run / ".hydra" / "config.yaml")
    saved.logger = {"backend": "wandb", "video_seconds": 8.0}
    OmegaConf.save(saved, run / ".hydra" / "config.yaml")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert "speed (m/s)" in call("evaluate", f"run={run}", "seconds=1", "env.num_envs=2")


def test_plugins_of_a_folder_are_not_imported(call, tmp_path, monkeypatch):
    run = shutil.copytree(POLICIES / "gecko", tmp_path / "run")
    saved = OmegaConf.load(run / ".hydra" / "config.yaml")
    saved.plugins = ["a_strangers_module"]
    OmegaConf.save(saved, run / ".hydra" / "config.yaml")
    (tmp_path / "a_strangers_module.py").write_text("raise SystemExit('it ran')")
    monkeypatch.syspath_prepend(tmp_path)
    assert "speed (m/s)" in call("evaluate", f"run={run}", "seconds=0.25", "env.num_envs=1")


@pytest.mark.filterwarnings("error:This module is instantiated on a machine without CUDA")
def test_a_policy_that_a_gpu_trained_walks_without_one(call, tmp_path):
    run = shutil.copytree(POLICIES / "gecko", tmp_path / "run")
    path = run / ".hydra" / "config.yaml"
    saved = OmegaConf.load(path)
    saved.physics.update(backend="warp", device="cuda:0", threads=None)
    saved.ppo.cudagraphs = True
    OmegaConf.save(saved, path)
    arguments = [f"run={run}", "physics=threaded", "seconds=1", "env.num_envs=2", "json=true"]
    assert strictly(call("evaluate", *arguments))["robots"] == 2


def test_another_arena_and_other_stepping_leave_the_bodies_as_they_were():
    saved = read_config(POLICIES / "gecko")
    gpu = {"backend": "warp", "device": "cuda:0", "contacts": 9, "stiffness": 5.0}
    saved |= {"physics": gpu, "arena": {"name": "hills", "height": 0.1}}
    overrides = parse(["physics=threaded", "physics.friction=0.5", "arena=ground"], "here")
    config = amended(saved, overrides, learning=False)
    assert config.physics == PhysicsConfig(stiffness=5.0, friction=0.5)
    assert config.arena == {"name": "ground"}


def test_a_recurrent_run_is_evaluated_and_exported_by_its_folder(call, tmp_path):
    small = ("env.num_envs=2", "ppo.steps=2", "ppo.minibatch_size=2", "ppo.iterations=1")
    execute(compose("network=gru", "+obs=history3", *small), tmp_path / "run")
    asked = (f"run={tmp_path / 'run'}", "seconds=1", "env.num_envs=3", "json=true")
    assert strictly(call("evaluate", *asked))["robots"] == 3
    file = tmp_path / "gait.onnx"
    assert call("export", f"run={tmp_path / 'run'}", f"output={file}") == f"{file}\n"
    assert file.stat().st_size > 10_000
