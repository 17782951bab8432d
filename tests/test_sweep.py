"""Sweeps: what runs, what is skipped, and what is refused before anything starts."""

import subprocess
import sys

import hydra
import pytest
from omegaconf import OmegaConf

from locomotion.command_line.composing import compose, compose_job, split_sweep
from locomotion.command_line.training import launch
from locomotion.config import conf_dir
from locomotion.runs import RunError, is_finished, record

SMALL = ["env.num_envs=3", "ppo.steps=4", "ppo.minibatch_size=6", "ppo.iterations=2"]
STICK = "name: stick\nbody: {module: core, children: {left: {module: hinge}}}\n"


def finish(folder, *overrides):
    """Leaves in a folder what a finished run leaves there."""
    config = compose(*overrides)
    record(folder, config=OmegaConf.structured(config))
    rows = [f"{iteration},0.1\n" for iteration in range(config.ppo.iterations)]
    (folder / "metrics.csv").write_text("".join(["iteration,mean_reward\n", *rows]))
    (folder / "checkpoints").mkdir()
    (folder / "checkpoints" / f"{config.ppo.iterations:06d}.ckpt").touch()
    (folder / "learning_curve.png").touch()


def refused(monkeypatch, capsys, *arguments):
    """The line with which a command is refused before its first job."""
    monkeypatch.setattr(sys, "argv", ["train", *arguments])
    with pytest.raises(SystemExit) as ended:
        launch(lambda config, folder: pytest.fail("the job was started"))
    printed = capsys.readouterr()
    assert ended.value.code == 2
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    return printed.err


def test_a_sweep_goes_on_with_what_is_not_finished(tmp_path):
    (tmp_path / "bodies" / "robot").mkdir(parents=True)
    (tmp_path / "bodies" / "robot" / "stick.yaml").write_text(STICK)
    command = [sys.executable, "-m", "locomotion.train", "--multirun", "--config-dir=bodies"]
    command += ["+experiment=ablation", "robot=stick", "+obs=hinges,history3", "seed=4", *SMALL]

    def sweep():
        result = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=300)
        assert result.returncode == 0, result.stderr
        assert "\r" not in result.stderr  # no progress bars that write over one another
        return sorted(line for line in result.stdout.splitlines() if line.startswith(str(tmp_path)))

    def state(folder):
        # Logs are opened for every job and may grow.
        files = (path for path in folder.rglob("*") if path.is_file() and path.suffix != ".log")
        return {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in files}

    whole = tmp_path / "sweeps" / "ablation" / "stick-hinges-seed4"
    torn = tmp_path / "sweeps" / "ablation" / "stick-history3-seed4"
    first = sweep()
    assert [line.split(": ")[0] for line in first] == [str(whole), str(torn)]
    assert all("m per action in the last ten iterations" in line for line in first)

    (torn / "checkpoints" / "000002.ckpt").unlink()
    before, torn_before = state(whole), state(torn)
    assert sweep() == [f"{whole}: finished before, skipped", first[1]]
    assert state(whole) == before
    assert state(torn).keys() > torn_before.keys()


def test_a_run_is_finished_with_all_rows_and_the_last_checkpoint(tmp_path):
    config = compose("ppo.iterations=3")
    assert not is_finished(tmp_path, config)
    finish(tmp_path, "ppo.iterations=3")
    assert is_finished(tmp_path, config)
    for name in ("metrics.csv", "checkpoints/000003.ckpt", "learning_curve.png"):
        content = (tmp_path / name).read_bytes()
        if content:
            (tmp_path / name).write_bytes(content[:-1])  # the last line is still being written
        else:
            (tmp_path / name).unlink()
        assert not is_finished(tmp_path, config)
        (tmp_path / name).write_bytes(content)


def test_only_keys_that_change_the_numbers_make_another_run(tmp_path):
    finish(tmp_path)
    same = [
        "physics.threads=3",
        "checkpoint_interval=7",
        "logger=tensorboard",
        "logger.video_seconds=0",
    ]
    assert is_finished(tmp_path, compose(*same))
    for override, message in {
        "ppo.gamma=0.9": "with ppo.gamma=0.99; with ppo.gamma=0.9 it",
        "obs.orientation=null": "with obs.orientation=quaternion; with obs.orientation=null it",
        "robot=ant": "with robot.name=gecko; with robot.name=ant it",
        "robot.body.children.back.rotation=0": "with robot.body.children.back.rotation=90; with",
    }.items():
        with pytest.raises(RunError) as refusal:
            is_finished(tmp_path, compose(override))
        assert str(refusal.value).startswith(f"{tmp_path} holds a run {message}")


@pytest.mark.parametrize("content", [None, "", "robot: [", "robot: ${nowhere}"])
def test_metrics_without_a_readable_configuration_are_not_written_over(tmp_path, content):
    finish(tmp_path)
    (tmp_path / ".hydra" / "config.yaml").unlink()
    if content is not None:
        (tmp_path / ".hydra" / "config.yaml").write_text(content)
    with pytest.raises(RunError, match=r"\.hydra/config\.yaml|holds a run with no"):
        is_finished(tmp_path, compose())


def test_a_changed_configuration_is_refused_before_the_first_job(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "sweeps" / "ablation" / "ant-hinges-seed0"
    finish(folder, "robot=ant", "+obs=hinges", "ppo.iterations=3")
    line = refused(monkeypatch, capsys, "--multirun", "+experiment=ablation", "ppo.iterations=4")
    there, asked = "ppo.iterations=3", "ppo.iterations=4"
    short = "sweeps/ablation/ant-hinges-seed0"
    assert (
        line == f"error: {short} holds a run with {there}; with {asked} it needs another folder\n"
    )
    line = refused(monkeypatch, capsys, f"hydra.run.dir={folder}")
    assert line.startswith(f"error: {folder} holds a run with robot.name=ant;")
    assert [path.name for path in tmp_path.rglob("*seed*")] == [folder.name]


def test_the_lists_of_an_experiment_are_checked_too(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine" / "experiment").mkdir(parents=True)
    (tmp_path / "mine" / "experiment" / "bad.yaml").write_text(
        "# @package _global_\nhydra: {mode: MULTIRUN, sweeper: {params: {seed: '0,-1'}}}\n"
    )
    line = refused(monkeypatch, capsys, "--config-dir=mine", "+experiment=bad")
    assert line.startswith("error: seed=-1 must be at least 0")
    line = refused(monkeypatch, capsys, "+experiment=ablation", "robot=gecko,lizard")
    assert line == "error: robot=lizard is unknown; choose from ant, gecko\n"
    line = refused(monkeypatch, capsys, "+experiment=ablation", "ppo.gamma=0.9,0.99")
    assert line.startswith("error: two jobs would write to sweeps/ablation/gecko-history3-seed0;")
    line = refused(monkeypatch, capsys, "+experiment=ablation", "physics.threads=many")
    assert line.startswith("error: physics.threads=many: Value 'many'")


def test_a_missing_launcher_is_named(tmp_path):
    code = (
        "import sys; sys.modules['hydra_plugins'] = None; sys.argv = ['train', '+experiment=ablation'];"
        "from locomotion.command_line.training import launch; launch(print)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path
    )
    assert result.returncode == 2
    assert result.stderr == (
        "error: jobs side by side need a package: pip install hydra-joblib-launcher\n"
    )


@pytest.mark.parametrize(
    ("cores", "threads", "jobs"),
    [(2, "1", 2), (16, "1", 16), (16, "3", 5), (2, "3", 1), (16, "null", 1)],
)
def test_jobs_side_by_side_have_a_core_for_each_thread(monkeypatch, cores, threads, jobs):
    monkeypatch.setattr("joblib.cpu_count", lambda: cores)
    overrides = ["+experiment=ablation", f"physics.threads={threads}"]
    compose()  # registers what the configuration refers to
    with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        config = hydra.compose("config", overrides, return_hydra_config=True)
    assert config.hydra.launcher.n_jobs == jobs


def test_the_ablation_is_every_robot_with_every_observation_and_seed():
    jobs = [compose_job(job, 0) for job in split_sweep(["+experiment=ablation"], False)]
    runs = [(config.seed, config.robot.name, *vars(config.obs).values()) for config, _ in jobs]
    assert len(set(runs)) == len(jobs) == 3 * 2 * 4
    assert len({folder for _, folder in jobs}) == len(jobs)
    assert {config.physics.threads for config, _ in jobs} == {1}
    assert len(split_sweep(["+experiment=ablation", "seed=3,4", "robot=ant"], False)) == 2 * 4
