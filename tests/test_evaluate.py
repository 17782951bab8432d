"""The command lines of evaluate, watch and export: what they print, and what they refuse."""

import json
import shutil
import subprocess
import sys

import pytest
from omegaconf import OmegaConf

from locomotion import evaluate, export, watch
from locomotion.command_line import policies
from locomotion.command_line.composing import amend, compose, parse
from locomotion.config.schema import PhysicsBackend
from locomotion.gaits import Disturbances, planned

COMMANDS = {"evaluate": evaluate, "watch": watch, "export": export}


def call(name, arguments, monkeypatch):
    monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
    COMMANDS[name].main()


def test_json_is_all_that_is_on_standard_output():
    arguments = ["seconds=1", "env.num_envs=3", "json=true", "robot=ant", "physics.friction=0.8"]
    command = [sys.executable, "-m", "locomotion.evaluate", *arguments]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    found = json.loads(result.stdout)
    assert (found["robot"], found["robots"], found["seconds"]) == ("ant", 3, 1.0)
    for how in ("mean_action", "sampled"):
        assert found[how]["speed"]["low"] < found[how]["speed"]["mean"]
        assert set(found[how]["on_back"]) == {"mean", "low", "high"}


def test_the_table_names_every_measure_and_one_robot_has_no_interval(monkeypatch, capsys):
    call("evaluate", ["seconds=1", "env.num_envs=1", "reality_check=true"], monkeypatch)
    table = capsys.readouterr().out
    for words in ("speed (m/s)", "heading drift (°/min)", "work per metre (J/m)", "on back"):
        assert words in table
    for words in ("physics.timestep=0.001", "delay=1", "push=0.5", "[nan%, nan%]"):
        assert words in table


@pytest.mark.parametrize("name", COMMANDS)
def test_help_names_every_key(name, monkeypatch, capsys):
    call(name, ["--help"], monkeypatch)
    text = capsys.readouterr().out
    for key in ("robot", "run", "physics.self_collision", "seed"):
        assert f"\n  {key} " in text
    assert "ant, gecko" in text
    assert ("env.num_envs" in text) == (name == "evaluate")


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("evaluate", ["robot=lizard"], "robot=lizard has no policy that comes along; choose from"),
        ("evaluate", ["robot=ant", "run=x"], "robot=ant and run=x name two policies"),
        ("evaluate", ["run=nowhere"], "nowhere holds no .hydra/config.yaml"),
        ("evaluate", ["secnds=3"], "secnds is no key; did you mean seconds?"),
        ("evaluate", ["seconds=0"], "seconds=0.0 must be above 0"),
        ("evaluate", ["seconds=soon"], "seconds"),
        ("evaluate", ["delay=-1"], "delay=-1 must be at least 0"),
        ("evaluate", ["noise=nan"], "noise=nan must be at least 0"),
        ("evaluate", ["json=perhaps"], "json: Value 'perhaps' is not a valid bool"),
        ("evaluate", ["physics.fiction=1"], "physics.fiction is no key; did you mean"),
        ("evaluate", ["physics.friction=-1"], "physics.friction=-1.0 must be at least 0"),
        ("evaluate", ["physics=bullet"], "physics=bullet is unknown; choose from"),
        ("evaluate", ["env.num_envs=0"], "env.num_envs=0 must be at least 1"),
        ("evaluate", ["env.time_limit=3"], "env.time_limit is null in this command"),
        ("evaluate", ["ppo.epochs=3"], "ppo.epochs is settled by training"),
        ("evaluate", ["+obs=history3"], "obs is settled by training"),
        ("evaluate", ["robot.body.module=brick"], "robot.body.module is settled by training"),
        ("evaluate", ["physics.friction=1,2"], "physics.friction=1,2 has no meaning for a policy"),
        ("evaluate", ["~physics"], "~physics has no meaning"),
        ("evaluate", ["hydra.run.dir=x"], "hydra.run.dir=x has no meaning"),
        ("evaluate", ["--multirun"], "--multirun is no flag of this command"),
        ("evaluate", ["gecko"], "Error parsing override 'gecko'"),
        ("watch", ["env.num_envs=3"], "env.num_envs is 1 in this command"),
        ("watch", ["output=film.avi"], "output=film.avi must be a file that ends in .mp4"),
        (
            "watch",
            ["web=true", "output=page.mp4"],
            "output=page.mp4 must be a file that ends in .ht",
        ),
        ("watch", ["web=true", "live=true"], "live=true must be false with web=true"),
        ("watch", ["width=801"], "width=801 height=450 must be even"),
        ("watch", ["fps=0"], "fps=0 must be at least 1"),
        ("export", ["output=gait.bin"], "output=gait.bin must be a file that ends in .onnx"),
        ("export", ["seconds=3"], "seconds is no key"),
        ("export", ["output=nowhere/x.onnx"], "output=nowhere/x.onnx: there is no folder nowhere"),
        ("watch", ["output=/proc/x.mp4"], "/proc cannot be written"),
    ],
)
def test_a_wrong_call_is_answered_in_one_line(name, arguments, message, monkeypatch, capsys):
    with pytest.raises(SystemExit) as ended:
        call(name, arguments, monkeypatch)
    printed = capsys.readouterr()
    assert ended.value.code == 2
    assert printed.out == ""
    assert printed.err.startswith("error: ")
    assert message in printed.err
    assert printed.err.count("\n") == 1


def test_a_run_without_a_checkpoint_is_named(tmp_path, monkeypatch, capsys):
    (tmp_path / ".hydra").mkdir()
    config = policies.POLICIES / "gecko" / ".hydra" / "config.yaml"
    (tmp_path / ".hydra" / "config.yaml").write_text(config.read_text())
    with pytest.raises(SystemExit):
        call("evaluate", [f"run={tmp_path}"], monkeypatch)
    assert capsys.readouterr().err == f"error: {tmp_path} holds no checkpoint yet\n"


def test_other_physics_leave_the_bodies_as_they_were():
    saved = OmegaConf.create({"physics": {"backend": "warp", "device": "cuda:0", "stiffness": 5.0}})
    amend(saved, parse(["physics=threaded", "physics.friction=0.5"], "here"))
    assert saved.physics.stiffness == 5.0
    assert saved.physics.friction == 0.5
    assert (saved.physics.backend, saved.physics.device) == (PhysicsBackend.threaded, "cpu")


def test_a_folder_of_another_project_is_refused_and_a_logger_need_not_be_installed(
    tmp_path, monkeypatch, capsys
):
    place = tmp_path / ".hydra" / "config.yaml"
    place.parent.mkdir()
    place.write_text("learning_rate: 3\n")
    with pytest.raises(SystemExit) as ended:
        call("evaluate", [f"run={tmp_path}"], monkeypatch)
    assert ended.value.code == 2
    assert "holds no run of this project" in capsys.readouterr().err

    saved = OmegaConf.load(policies.POLICIES / "gecko" / ".hydra" / "config.yaml")
    saved.logger = {"backend": "wandb", "video_seconds": 8.0}
    OmegaConf.save(saved, place)
    shutil.copytree(policies.POLICIES / "gecko" / "checkpoints", tmp_path / "checkpoints")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    call("evaluate", [f"run={tmp_path}", "seconds=1", "env.num_envs=2"], monkeypatch)
    assert "speed (m/s)" in capsys.readouterr().out


def test_a_change_that_changes_nothing_is_left_out_and_others_come_on_top():
    config = compose("physics.self_collision=true", "physics.timestep=0.01")
    overrides = [row[-1] for row in planned(config, Disturbances(delay=2, push=0.5))]
    assert "physics.self_collision=true" not in overrides
    assert overrides[-3:] == ["delay=3", "noise=0.05", "push=1"]


def test_a_policy_that_a_gpu_trained_walks_without_one(tmp_path, monkeypatch, capsys):
    run = shutil.copytree(policies.POLICIES / "gecko", tmp_path / "run")
    path = run / ".hydra" / "config.yaml"
    saved = OmegaConf.load(path)
    saved.physics.update(backend="warp", device="cuda:0", threads=None)
    saved.ppo.cudagraphs = True
    OmegaConf.save(saved, path)
    arguments = [f"run={run}", "physics=threaded", "seconds=1", "env.num_envs=2", "json=true"]
    call("evaluate", arguments, monkeypatch)
    assert json.loads(capsys.readouterr().out)["robots"] == 2
