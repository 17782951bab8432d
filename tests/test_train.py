"""The command line as a user meets it."""

import csv
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from locomotion.assembly import make_env, make_policy
from locomotion.command_line.composing import compose
from locomotion.config import Config, load, typed
from locomotion.runs.checkpoints import Checkpoints

ROOT = Path(__file__).parents[1]
SMALL = ["env.num_envs=3", "ppo.steps=4", "ppo.minibatch_size=6", "ppo.iterations=2"]
TIMINGS = {"collect_seconds", "update_seconds"}


def train(*overrides, **keywords):
    command = [sys.executable, "-m", "locomotion.train", *overrides]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **keywords)


def rows(run):
    with (run / "metrics.csv").open() as file:
        return [
            {key: value for key, value in row.items() if key not in TIMINGS}
            for row in csv.DictReader(file)
        ]


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    """Two observations and a robot from a folder of the user's own, in one sweep."""
    home = tmp_path_factory.mktemp("home")
    (home / "bodies" / "robot").mkdir(parents=True)
    (home / "bodies" / "robot" / "stick.yaml").write_text(
        "name: stick\nbody: {module: core, children: {left: {module: hinge}}}\n"
    )
    result = train(
        *("--multirun", "--config-dir=bodies", "robot=stick", "+obs=hinges,history3"),
        *(
            "seed=7",
            "logger=tensorboard",
            "logger.video_seconds=0",
            "hydra.sweep.dir=sweep",
            *SMALL,
        ),
        cwd=home,
    )
    assert result.returncode == 0, result.stderr
    return home / "sweep"


def test_a_run_leaves_metrics_checkpoints_and_a_picture(sweep):
    for job, actor_inputs in (("0", [1]), ("1", [3, 4])):
        run = sweep / job
        metrics = rows(run)
        assert list(metrics[0])[:4] == ["iteration", "frames", "mean_reward", "mean_value"]
        assert [row["frames"] for row in metrics] == ["12", "24"]
        config = typed(Config, OmegaConf.load(run / ".hydra" / "config.yaml"))
        env = make_env(config)
        actor = make_policy(config, env)
        assert Checkpoints(run, actor=actor).load_latest() == 2
        assert [encoder.in_features for encoder in actor.module[0].net.encoders] == actor_inputs
        assert (run / "learning_curve.png").read_bytes().startswith(b"\x89PNG")
        assert list((run / "tensorboard").glob("events*"))
        assert OmegaConf.load(run / ".hydra" / "config.yaml").robot.name == "stick"


def test_the_same_seed_gives_the_same_run_alone_in_a_sweep_and_on_other_threads(sweep, tmp_path):
    overrides = ["--config-dir=bodies", "robot=stick", "+obs=history3", "physics.threads=1", *SMALL]
    for seed in (7, 8):
        run = tmp_path / str(seed)
        result = train(*overrides, f"seed={seed}", f"hydra.run.dir={run}", cwd=sweep.parent)
        assert result.returncode == 0, result.stderr
        assert (rows(run) == rows(sweep / "1")) == (seed == 7)


def test_plot_compares_runs_and_names_what_is_none(sweep, tmp_path):
    command = [sys.executable, "-m", "locomotion.plot"]
    picture = tmp_path / "curves.png"
    subprocess.run([*command, sweep / "0", sweep / "1", "--output", picture], check=True)
    assert picture.read_bytes().startswith(b"\x89PNG")
    result = subprocess.run([*command, tmp_path], capture_output=True, text=True)
    assert result.returncode == 2
    assert result.stderr == f"error: {tmp_path} holds no metrics.csv, so it is no run's folder\n"


def test_nothing_heavy_is_imported_before_the_configuration_is_checked():
    code = "import sys, locomotion.train; print({'torch', 'mujoco', 'matplotlib'} & {*sys.modules})"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout == "set()\n"


def test_help_names_every_choice_and_key():
    text = train("--help").stdout
    for choice in ("ant, gecko", "hinges, hinges_orientation, history3, history3_hinges"):
        assert choice in text
    for key in ("env.num_envs", "physics.timestep", "physics.threads", "ppo.epochs", "seed"):
        assert f"\n  {key} " in text


def test_without_a_choice_the_policy_sees_hinges_and_orientation():
    assert compose().obs == load("obs/hinges_orientation") == compose("+obs=hinges_orientation").obs


def test_defaults_are_the_reports():
    config = compose()
    assert (config.env.num_envs, config.ppo.steps, config.ppo.iterations) == (64, 128, 200)
    assert (config.ppo.epochs, config.ppo.minibatch_size) == (4, 2048)
    assert (config.ppo.actor_lr, config.ppo.critic_lr) == (0.0008, 0.001)
    assert (config.ppo.gamma, config.ppo.gae_lambda, config.ppo.clip_epsilon) == (0.99, 0.95, 0.2)
    assert (config.ppo.entropy_coeff, config.env.control_frequency) == (0.01, 4.0)


def test_a_gecko_learns_within_seconds(tmp_path):
    options = ("+obs=history3", "+experiment=quick", "ppo.iterations=25")
    result = train(*options, "hydra.run.dir=run", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    rewards = [float(row["mean_reward"]) for row in rows(tmp_path / "run")]
    # Other seeds come to 0.12, chance is 0.02.
    assert rewards[0] < 0.03 and max(rewards) > 0.08


def test_settings_for_a_gpu_are_for_one():
    config = compose("+experiment=gpu")
    assert (config.physics.device, config.env.num_envs) == ("cuda:0", 4096)
    assert config.env.num_envs * config.ppo.steps % config.ppo.minibatch_size == 0


def test_a_wheel_carries_configuration_and_policies(tmp_path):
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--no-deps", "-q", "-w", tmp_path, ROOT], check=True
    )
    (wheel,) = tmp_path.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path / 'site')!r});"
        "from locomotion.command_line.composing import compose; from locomotion.config import conf_dir;"
        "from locomotion.plots import REPORT, read_csv;"
        "from locomotion.command_line.policies import POLICIES, shipped; from locomotion.runs import read_config;"
        "print(conf_dir(), compose('robot=ant').robot.name, len(read_csv(REPORT)));"
        "print(*shipped(), read_config(POLICIES / 'gecko')['robot']['name']);"
        "print(*POLICIES.glob('*/checkpoints/*.ckpt'))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path
    )
    first, second, third = result.stdout.splitlines()
    assert first == f"{tmp_path / 'site' / 'locomotion' / 'conf'} ant 6"
    assert second == "ant gecko gecko"
    assert third.count(".ckpt") == 2
