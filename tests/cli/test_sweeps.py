"""Sweeps: all jobs are checked before the first one runs."""

import pytest

from locomotion import compose
from locomotion.cli.composing import compose_jobs, normalised
from locomotion.config import as_dict
from locomotion.runs import record

pytestmark = pytest.mark.slow


def finish(folder, *overrides):
    """Leaves in a folder what a finished run leaves there."""
    config = compose(*overrides)
    iterations = config.learner.iterations
    record(folder, config=as_dict(config))
    rows = [f"{iteration},0.1\n" for iteration in range(iterations)]
    (folder / "metrics.csv").write_text("".join(["iteration,mean_reward\n", *rows]))
    (folder / "checkpoints").mkdir()
    (folder / "checkpoints" / f"{iterations:06d}.ckpt").touch()
    (folder / "learning_curve.png").touch()


def test_a_changed_configuration_is_refused_before_the_first_job(refusal, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "sweeps" / "ablation" / "ant-hinges-seed0"
    finish(folder, "robot=ant", "+obs=hinges", "ppo.iterations=3")
    line = refusal("--multirun", "+experiment=ablation", "ppo.iterations=4")
    assert line == (
        "sweeps/ablation/ant-hinges-seed0 holds a run with ppo.iterations=3;"
        " with ppo.iterations=4 it needs another folder"
    )
    line = refusal(f"hydra.run.dir={folder}")
    assert line.startswith(f"{folder} holds a run with robot.name=ant;")
    assert [path.name for path in tmp_path.rglob("*seed*")] == [folder.name]


@pytest.mark.parametrize("content", [None, "", "robot: [", "robot: ${nowhere}"])
def test_metrics_without_a_readable_record_are_not_written_over(content, refusal, tmp_path):
    finish(tmp_path)
    path = tmp_path / ".hydra" / "config.yaml"
    path.unlink() if content is None else path.write_text(content)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    line = refusal(f"hydra.run.dir={tmp_path}")
    assert ".hydra/config.yaml" in line or f"{tmp_path} holds a run with no " in line
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--config-dir=mine", "+experiment=bad"], "seed=-1 must be at least 0"),
        (
            ["+experiment=ablation", "robot=gecko,lizard"],
            "robot=lizard is unknown; choose from ant",
        ),
        (
            ["+experiment=ablation", "ppo.gamma=0.9,0.99"],
            "two jobs would write to sweeps/ablation/gecko-history3-seed0;",
        ),
        (["+experiment=ablation", "physics.threads=many"], "physics.threads=many: Value 'many'"),
        (["+experiment=ablation", "seed=range(3,3)"], "seed=range(3,3) holds no value"),
        (["--multirun", "ppo.epochs=1,2,3,0"], "ppo.epochs=0 must be at least 1"),
        (["--multirun", "+experiment=quick,slow"], "experiment=slow is unknown; choose from"),
        (["--multirun", "seed=0,1", "hydra.sweep.subdir=x"], "two jobs would write to multirun/"),
    ],
)
def test_the_last_job_is_checked_before_the_first_one_runs(
    arguments, message, refusal, write, monkeypatch, tmp_path
):
    write(
        "mine/experiment/bad.yaml",
        "# @package _global_\nhydra: {mode: MULTIRUN, sweeper: {params: {seed: '0,-1'}}}\n",
    )
    monkeypatch.chdir(tmp_path)
    assert refusal(*arguments).startswith(message)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_jobs_are_those_of_hydras_grammar(write, stick, tmp_path):
    write("mine/robot/stick.yaml", stick)
    names = [
        "robot=glob([g*,stick*],exclude=[ga*,*-file])",
        "seed=range(1,6,2)",
        "ppo.gamma=choice(0.9,0.99)",
    ]
    jobs = compose_jobs(names, multirun=True, config_dir=tmp_path / "mine")
    found = [(config.robot.name, config.seed, config.learner.gamma) for config, _ in jobs]
    assert found == [
        (robot, seed, gamma)
        for robot in ("gecko", "stick")
        for seed in (1, 3, 5)
        for gamma in (0.9, 0.99)
    ]
    assert [folder.name for _, folder in jobs] == [str(number) for number in range(12)]
    assert len({folder.parent for _, folder in jobs}) == 1


def test_a_glob_finds_the_choices_of_a_folder_of_ones_own(write, stick, tmp_path):
    write("mine/robot/stick.yaml", stick)
    write("mine/experiment/my_first.yaml", "# @package _global_\nseed: 4\n")
    overrides = ["robot=glob(stick)", "+experiment=glob(my_*)"]
    ((config, _),) = compose_jobs(normalised(overrides), True, tmp_path / "mine")
    assert (config.robot.name, config.seed) == ("stick", 4)


def test_the_lists_of_the_command_line_replace_those_of_an_experiment(write, tmp_path):
    write(
        "mine/experiment/my.yaml",
        "# @package _global_\n"
        "hydra: {sweeper: {params: {obs: 'hinges,history3', seed: '0,1', ppo.gamma: '0.9,0.8'}}}\n",
    )
    overrides = ["+experiment=my", "+obs=hinges_orientation", "seed=5"]
    jobs = compose_jobs(normalised(overrides), True, tmp_path / "mine")
    assert [(config.seed, config.learner.gamma) for config, _ in jobs] == [(5, 0.9), (5, 0.8)]
    assert {tuple(config.obs) for config, _ in jobs} == {("hinge_position", "core_orientation")}
    ((single, folder),) = compose_jobs(normalised(overrides), config_dir=tmp_path / "mine")
    assert (single.learner.gamma, folder.parts[0]) == (0.99, "outputs")
