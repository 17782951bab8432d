"""The command line of training as a user meets it."""

import csv
import json
import re

import pytest
import yaml

pytestmark = pytest.mark.slow

TIMINGS = {"collect_seconds", "update_seconds"}


def rows(run):
    with (run / "metrics.csv").open() as file:
        return [
            {key: value for key, value in row.items() if key not in TIMINGS}
            for row in csv.DictReader(file)
        ]


@pytest.fixture(scope="module")
def sweep(tmp_path_factory, command, small, stick):
    """Two observations and a robot from a folder of the user's own, in one sweep."""
    home = tmp_path_factory.mktemp("home")
    (home / "bodies" / "robot").mkdir(parents=True)
    (home / "bodies" / "robot" / "stick.yaml").write_text(stick)
    arguments = ["--multirun", "--config-dir", "bodies", "robot=stick", "+obs=hinges,history3"]
    arguments += ["seed=7", "logger=tensorboard", "logger.video_seconds=0", "hydra.sweep.dir=sweep"]
    result = command("train", *arguments, *small, cwd=home)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    return home / "sweep"


def test_a_run_leaves_its_record_metrics_checkpoints_and_a_picture(sweep):
    for job, steps in (("0", 1), ("1", 3)):
        run = sweep / job
        metrics = rows(run)
        assert list(metrics[0])[:4] == ["iteration", "frames", "mean_reward", "mean_value"]
        assert [row["frames"] for row in metrics] == ["12", "24"]
        config = yaml.safe_load((run / ".hydra" / "config.yaml").read_text())
        assert (config["robot"]["name"], config["seed"]) == ("stick", 7)
        assert config["obs"]["hinge_position"]["steps"] == steps
        overrides = yaml.safe_load((run / ".hydra" / "overrides.yaml").read_text())
        assert {"seed=7", "robot=stick"} < {*overrides}
        assert (run / ".hydra" / "hydra.yaml").is_file()
        assert (run / "checkpoints" / "000002.ckpt").is_file()
        assert (run / "learning_curve.png").read_bytes().startswith(b"\x89PNG")
        assert list((run / "tensorboard").glob("events*"))


def test_the_same_seed_gives_the_same_run_alone_in_a_sweep_and_on_other_threads(
    sweep, command, small, tmp_path
):
    arguments = ["--config-dir=bodies", "robot=stick", "obs=history3", "physics.threads=1", *small]
    for seed in (7, 8):
        run = tmp_path / str(seed)
        place = f"hydra.run.dir={run}"
        result = command("train", *arguments, f"seed={seed}", place, cwd=sweep.parent)
        assert result.returncode == 0, result.stderr
        told, hint = result.stdout.splitlines()
        assert told.startswith(f"{run}: ")
        reward, speed = re.search(
            r": (\S+) m per action in .* iterations, (\S+) m/s$", told
        ).groups()
        assert float(speed) == pytest.approx(4 * float(reward), abs=0.006)
        assert hint == f"python -m locomotion.watch run={run} web=true shows the gait"
        assert (rows(run) == rows(sweep / "1")) == (seed == 7)


def test_every_robot_is_trained_by_a_glob(command, small, tmp_path):
    arguments = ["--multirun", "robot=glob([ant,ge*])", "hydra.sweep.dir=sweep", *small]
    result = command("train", *arguments, "hydra.sweep.subdir=${robot.name}", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    runs = sorted(path.parent.name for path in tmp_path.glob("sweep/*/metrics.csv"))
    assert runs == ["ant", "gecko"]


def test_observations_of_ones_own_are_yaml_alone(command, small, stick, write, tmp_path):
    write("my_own_ß/robot/stick.yaml", stick)
    write(
        "my_own_ß/obs/mine.yaml",
        "core_height:\nturning: {reading: core_angular_velocity, steps: 2, scale: 0.5}\n"
        "core_orientation: {representation: gravity}\n",
    )
    arguments = ["--config-dir=my_own_ß", "robot=stick", "+obs=mine", "hydra.run.dir=run", *small]
    result = command("train", *arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert len(rows(tmp_path / "run")) == 2
    shown = command("evaluate", "run=run", "seconds=1", "json=true", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert json.loads(shown.stdout)["robots"] == 64


def test_a_resumed_run_may_be_longer(command, small, stick, write, tmp_path):
    path = write("stick.yaml", stick)
    run = ["hydra.run.dir=größe 1/лист", f"robot={path}"]
    result = command("train", *run, *small, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    before = rows(tmp_path / "größe 1" / "лист")
    longer = ["resume=größe 1/лист", "ppo.iterations=3", "physics.threads=1"]
    result = command("train", *longer, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    after = rows(tmp_path / "größe 1" / "лист")
    assert (after[:2], len(after)) == (before, 3)
    again = command("train", *longer, cwd=tmp_path)
    assert again.stdout == "größe 1/лист: finished before, skipped\n"
    walked = command("evaluate", "run=größe 1/лист", "seconds=1", cwd=tmp_path)
    assert walked.returncode == 0, walked.stderr


def test_help_names_every_choice_and_key(command, tmp_path):
    text = command("train", "--help", cwd=tmp_path).stdout
    for choice in (
        "ant, babya",
        "gecko, insect",
        "hinges, hinges_orientation, history3, history3_hinges",
    ):
        assert choice in text
    keys = ("env.num_envs", "physics.timestep", "physics.threads", "ppo.epochs", "seed")
    keys += (
        "obs.TERM.steps",
        "network.hidden",
        "task.rewards.velocity.direction",
        "hinge_velocity",
    )
    for key in keys:
        assert f"\n  {key} " in text
    assert "rad/s" in text
    assert "$" not in text


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        (["--cfg", "job", "seed=3"], "\nseed: 3\n"),
        (["-c", "job", "-p", "env", "env.num_envs=99"], "# @package env\nnum_envs: 99\n"),
        (["--cfg=hydra", "-p", "hydra.sweep"], "# @package hydra.sweep\ndir: "),
        (["--cfg=job", "--resolve", "-cd=."], "\nppo:\n"),
        (["--info", "searchpath", "-cd", "."], "command-line"),
        (["--hydra-help"], "Hydra ("),
        (["-sc", "install=bash"], "hydra_bash_completion()"),
    ],
)
def test_hydras_flags_inform(arguments, shown, command, tmp_path):
    result = command("train", *arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert shown in result.stdout
    assert not list(tmp_path.iterdir())
