"""Launchers and sweepers: by an allow-list, so that a stranger's configuration runs no code."""

import textwrap

import hydra
import pytest
from filelock import FileLock

from locomotion import compose
from locomotion.cli.composing import compose_jobs
from locomotion.options import conf_dir

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["hydra/sweeper=basic"],
            "hydra/sweeper=basic is not allowed; choose from hydra/sweeper=gr",
        ),
        (["hydra/launcher=mine"], "hydra/launcher=mine is unknown; choose from basic, "),
        (["hydra/sweeper=mine"], "hydra/sweeper=mine is unknown; choose from basic"),
        (["hydra.launcher._target_=os.system"], "hydra.launcher._target_=os.system is fixed"),
        (["hydra.sweeper._target_=os.system"], "hydra.sweeper._target_=os.system is fixed"),
        (["++hydra.sweeper.max_batch_size=1"], "hydra.sweeper.max_batch_size=1 is fixed"),
        (["hydra/launcher=parallel", "++hydra.launcher.backend=x"], "launcher.backend=x is fixed"),
        (
            ["hydra/launcher=parallel", "hydra.launcher.n_jobs=0"],
            "n_jobs=0 must be a whole number of at",
        ),
        (["hydra/launcher=slurm", "+hydra.launcher.setup=[reboot]"], "setup=['reboot'] is fixed"),
        (["hydra/launcher=slurm", "hydra.launcher.partition='a\n#SBATCH'"], "must be a word of"),
        (["hydra/launcher=slurm", "hydra.launcher.qos='a b'"], "launcher.qos='a b' must be a word"),
        (
            ["hydra/launcher=slurm", "hydra.launcher.account='--wrap=x'"],
            "account='--wrap=x' must be",
        ),
        (["hydra/launcher=slurm", "hydra.launcher.time=0"], "time=0 must be a whole number of at"),
        (["hydra/launcher=ray", "+hydra.launcher.address=x:1"], "launcher.address=x:1 is fixed"),
        (["hydra/launcher=ray", "hydra.launcher.cpus=0.5"], "cpus=0.5 must be a whole number of"),
        (["hydra/launcher=ray", "hydra.launcher.memory=x"], "memory=x must be a number of at"),
        (
            ["+hydra.callbacks.x._target_=os.system"],
            "hydra.callbacks.x._target_=os.system is fixed",
        ),
        (["hydra/job_logging=default"], "hydra.job_logging"),
        (["++hydra.job_logging.handlers.x.class=logging.FileHandler"], "FileHandler is fixed"),
        (["--help", "++hydra.hydra_logging.handlers.x.filename=y"], "hydra.hydra_logging"),
        (["+hydra.job.env_set.LD_PRELOAD=x.so"], "hydra.job.env_set"),
        (["hydra.job.env_copy=[HOME]"], "hydra.job.env_"),
        (["hydra.job.chdir=true"], "hydra.job.chdir=True is fixed"),
        (["hydra.verbose=true"], "hydra.verbose=True is fixed; it stays False"),
        (["hydra.output_subdir=x"], "hydra.output_subdir=x is fixed; it stays None"),
    ],
)
def test_what_hydra_calls_and_opens_is_fixed(arguments, message, refusal, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for mode in ([], ["--multirun", "seed=0,1"]):
        if "--help" not in arguments or not mode:
            assert message in refusal(*arguments, *mode)
    assert not list(tmp_path.iterdir())


@pytest.mark.filterwarnings("ignore:(?s).*validated against ConfigStore schema")
@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ("launcher=mine", "hydra/launcher=mine is not allowed; choose from hydra/launcher=basic"),
        ("sweeper=mine", "hydra/sweeper=mine is not allowed; choose from hydra/sweeper=grid"),
        # One that is allowed but not installed cannot be put in its place, nor Hydra's own replaced.
        ("sweeper=optuna", "hydra/sweeper=optuna is unknown; choose from basic"),
        ("launcher=basic", "hydra.launcher._target_=os.mkdir is fixed"),
    ],
)
def test_a_strangers_launcher_is_not_called(choice, message, refusal, write, monkeypatch, tmp_path):
    kind, _, name = choice.partition("=")
    write(f"theirs/hydra/{kind}/{name}.yaml", "_target_: os.mkdir\n")
    monkeypatch.chdir(tmp_path)
    arguments = ["--config-dir=theirs", "--multirun", "seed=0,1", f"hydra/{choice}"]
    assert message in refusal(*arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["theirs"]


STRANGERS = {
    "hydra: {callbacks: {x: {_target_: os.system}}}\n": "os.system is fixed",
    "hydra: {launcher: {_target_: os.system}}\n": "os.system is fixed",
    "hydra: {sweeper: {_target_: os.system, params: {seed: '0,1'}}}\n": "os.system is fixed",
    "hydra: {job_logging: {handlers: {file: {filename: crater}}}}\n": "is fixed",
    "hydra: {hydra_logging: {handlers: {file: {filename: crater}}}}\n": "is fixed",
    "hydra: {job: {env_set: {LD_PRELOAD: crater}}}\n": "hydra.job.env_set.LD_PRELOAD=crater is fixed",
    "hydra: {mode: MULTIRUN, sweeper: {params: {plugins: '[crater]'}}}\n": "crater has not been",
    "plugins: [crater]\n": "plugins=crater has not been imported; +plugins=[crater] does that",
    "_target_: os.system\n": "_target_ is not a key",
}


@pytest.mark.parametrize("content", STRANGERS)
@pytest.mark.parametrize("override", ["robot=mine", "+experiment=mine"])
def test_a_strangers_folder_runs_no_code(content, override, refusal, write, monkeypatch, tmp_path):
    write("crater.py", "open('crater', 'w')")
    body = "robot: {name: red, body: {module: core, children: {left: {module: hinge}}}}\n"
    text = f"# @package _global_\n{body if override == 'robot=mine' else ''}{content}"
    write(f"theirs/{override.strip('+').split('=')[0]}/mine.yaml", text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    assert STRANGERS[content] in refusal("--config-dir=theirs", override)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["crater.py", "theirs"]


def test_a_body_is_data_too(refusal, write, tmp_path):
    body = "body: {module: core, children: {left: {module: hinge}}}\n"
    write(
        "robot/a.yaml", f"name: red\n{body}hydra: {{callbacks: {{x: {{_target_: os.system}}}}}}\n"
    )
    assert "robot.hydra is not a key" in refusal(f"--config-dir={tmp_path}", "robot=a")
    assert "robot.hydra is not a key" in refusal(f"robot={tmp_path / 'robot' / 'a.yaml'}")
    write("robot/b.yaml", f"defaults: [{{x: y}}]\nname: red\n{body}")
    assert "x" in refusal(f"--config-dir={tmp_path}", "robot=b")
    assert "robot.defaults is not a key" in refusal(f"robot={tmp_path / 'robot' / 'b.yaml'}")


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


def test_jobs_side_by_side_train_and_resume(command, small, stick, write, tmp_path):
    write("stick.yaml", stick)
    arguments = ["--multirun", "+experiment=ablation", "robot=stick.yaml", "+obs=hinges,history3"]
    arguments += ["seed=4", *small]
    home = tmp_path / "sweeps" / "ablation"
    whole, torn = home / "stick-file-hinges-seed4", home / "stick-file-history3-seed4"

    def sweep():
        result = command("train", *arguments, cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        assert "\r" not in result.stderr  # no progress bars that write over one another
        return sorted(line for line in result.stdout.splitlines() if line.startswith(str(tmp_path)))

    def state(folder):
        files = (path for path in folder.rglob("*") if path.is_file())
        return {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in files}

    first = sweep()
    assert [line.split(": ")[0] for line in first] == [str(whole), str(torn)]
    assert all("m per action in the last ten iterations" in line for line in first)
    rows = (torn / "metrics.csv").read_text()

    (torn / "checkpoints" / "000002.ckpt").unlink()
    before = state(whole)
    assert sweep() == [f"{whole}: finished before, skipped", first[1]]
    assert state(whole) == before
    assert (torn / "checkpoints" / "000002.ckpt").is_file()
    columns = [row.split(",")[:4] for row in rows.splitlines()]
    assert [
        row.split(",")[:4] for row in (torn / "metrics.csv").read_text().splitlines()
    ] == columns


@pytest.mark.parametrize("launcher", ["basic", "parallel"])
def test_a_sweep_ends_with_the_line_of_a_job_that_cannot_run(
    launcher, command, small, stick, write, tmp_path
):
    write("stick.yaml", stick)
    (tmp_path / "sweep" / "0").mkdir(parents=True)
    arguments = ["--multirun", f"hydra/launcher={launcher}", "robot=stick.yaml", "seed=0,1", *small]
    arguments += ["hydra.sweep.dir=sweep", "physics.threads=1"]
    with FileLock(tmp_path / "sweep" / "0" / ".lock"):
        result = command("train", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    line = f"error: {tmp_path}/sweep/0: another process is training there\n"
    assert result.stderr == line


SWEEPER = textwrap.dedent(
    '''
    """A sweeper in Optuna's place: two jobs, one after the other; writes down what came of them."""

    import dataclasses
    import itertools
    from pathlib import Path

    from hydra.core.config_store import ConfigStore
    from hydra.core.plugins import Plugins
    from hydra.plugins.sweeper import Sweeper


    class Drawing(Sweeper):
        def __init__(self, params, n_trials, n_jobs, direction, study_name):
            self.params, self.n_trials = params, n_trials

        def setup(self, *, hydra_context, task_function, config):
            self.config = config
            self.launcher = Plugins.instance().instantiate_launcher(
                hydra_context=hydra_context, task_function=task_function, config=config
            )

        def sweep(self, arguments):
            place = Path(self.config.hydra.sweep.dir)
            place.mkdir(parents=True, exist_ok=True)
            kept = [text for text in arguments if "interval" not in text]
            for trial in range(self.n_trials):
                job = [*kept, f"ppo.gamma={0.9 + trial / 100}"]
                (done,) = self.launcher.launch([job], initial_job_idx=trial)
                with (place / "objectives.txt").open("a") as file:
                    file.write(f"{done.return_value}\\n")


    @dataclasses.dataclass
    class DrawingConfig:
        _target_: str = "hydra_plugins.drawing.Drawing"
        params: dict | None = None
        n_trials: int = 2
        n_jobs: int = 1
        direction: str = "maximize"
        study_name: str | None = None


    ConfigStore.instance().store(group="hydra/sweeper", name="optuna", node=DrawingConfig)
    '''
)


def test_the_result_of_a_job_is_its_final_reward(command, small, stick, write, tmp_path):
    write("site/hydra_plugins/drawing.py", SWEEPER)
    write("stick.yaml", stick)
    arguments = ["--multirun", "hydra/sweeper=optuna", "robot=stick.yaml", *small]
    arguments += ["ppo.iterations=12", "ppo.gamma=interval(0.9,0.99)", "hydra.sweep.dir=sweep"]
    result = command("train", *arguments, cwd=tmp_path, path=tmp_path / "site")
    assert result.returncode == 0, result.stderr
    objectives = (tmp_path / "sweep" / "objectives.txt").read_text().split()
    for job, objective in enumerate(objectives):
        rows = (tmp_path / "sweep" / str(job) / "metrics.csv").read_text().splitlines()[1:]
        rewards = [float(row.split(",")[2]) for row in rows]
        assert len(rewards) == 12
        assert float(objective) == pytest.approx(sum(rewards[-10:]) / 10, abs=1e-9)
    assert len(set(objectives)) == 2
    # A typo is found before the sweeper draws, and its keys are on the list too.
    for wrong, message in (
        ("ppo.gama=interval(0.9,0.99)", "ppo.gama is not a key; did you mean ppo.gamma?"),
        ("hydra.sweeper._target_=os.system", "hydra.sweeper._target_=os.system is fixed"),
    ):
        result = command("train", *arguments, wrong, cwd=tmp_path, path=tmp_path / "site")
        assert (result.returncode, result.stderr.count("\n")) == (2, 1), result.stderr
        assert message in result.stderr


def test_the_ablation_is_every_robot_with_every_observation_and_seed():
    jobs = compose_jobs(["+experiment=ablation"])
    runs = {(config.seed, config.robot.name, str(config.obs)) for config, _ in jobs}
    assert len(runs) == len(jobs) == 3 * 2 * 4
    assert {str(folder) for _, folder in jobs} == {
        f"sweeps/ablation/{robot}-{observations}-seed{seed}"
        for robot in ("gecko", "ant")
        for observations in ("history3", "hinges_orientation", "hinges", "history3_hinges")
        for seed in range(3)
    }
    # All eight combinations have a seed before one has two.
    assert [config.seed for config, _ in jobs] == [0] * 8 + [1] * 8 + [2] * 8
    assert {config.physics.threads for config, _ in jobs} == {1}
    assert len(compose_jobs(["+experiment=ablation", "seed=3,4", "robot=ant"])) == 2 * 4


def test_a_launcher_without_its_package_is_refused_in_a_line(capsys):
    from hydra_plugins.locomotion_sweeps.needs import require_package

    require_package("json", "ray")
    with pytest.raises(SystemExit) as ended:
        require_package("no_such_package", "ray")
    assert ended.value.code == 2
    line = "error: hydra/launcher=ray needs packages: pip install 'locomotion[ray]'\n"
    assert capsys.readouterr().err == line
