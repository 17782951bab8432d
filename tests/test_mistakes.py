"""Wrong calls: one line that names what is wrong and what is allowed, status 2, nothing written."""

import os
import sys

import pytest
from omegaconf import OmegaConf

from locomotion.command_line.composing import compose
from locomotion.command_line.training import launch
from locomotion.config import schema
from locomotion.runs import record

GECKO = "robot gecko: core"


def refusal(arguments, monkeypatch, capsys):
    """The line with which ``python -m locomotion.train`` refuses its arguments."""
    monkeypatch.setattr(sys, "argv", ["train", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        launch(lambda config, folder: pytest.fail("the job was started"))
    printed = capsys.readouterr()
    assert ended.value.code == 2
    assert printed.out == ""
    assert printed.err.startswith("error: ")
    assert printed.err.count("\n") == 1
    return printed.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        # Parts and keys that are not there.
        (["robot=lizard"], "robot=lizard is unknown; choose from ant, gecko"),
        (["+obs=history"], "obs=history is unknown; choose from hinges, hinges_orientation"),
        (["obs=history3"], "use +obs=history3"),
        (["logger=paper"], "logger=paper is unknown; choose from csv, tensorboard, wandb"),
        (["physics=bullet"], "physics=bullet is unknown; choose from threaded"),
        (["ppo=best"], "ppo=best is unknown; choose from report"),
        (["+experiment=mine"], "experiment=mine is unknown; choose from ablation"),
        (["ppo.iteration=3"], "ppo.iteration is no key; did you mean ppo.iterations?"),
        (["pppo.epochs=3"], "pppo is no key; did you mean ppo?"),
        (["+frames=3"], "frames is no key"),
        (["++ppo.lr=3"], "ppo.lr is no key"),
        (["+env.robots=3"], "env.robots is no key"),
        (["hydra.nothing=3"], "hydra.nothing is no key"),
        # Values of the wrong type.
        (["ppo.epochs=many"], "ppo.epochs=many: Value 'many' of type 'str'"),
        (["env.num_envs=1.5"], "env.num_envs=1.5: Value '1.5' of type 'float'"),
        (["env.num_envs=[1,2]"], "env.num_envs"),
        (["seed=null"], "seed=null"),
        (["env=null"], "env=null"),
        (["obs.orientation=euler"], "expected one of [quaternion, rotation_6d, gravity, yaw]"),
        (["logger.backend=paper"], "expected one of [csv, tensorboard, wandb]"),
        (["physics.timestep=fast"], "physics.timestep=fast"),
        (["robot.body=gecko"], "robot.body=gecko"),
        (["ppo=3"], "ppo=3"),
        (["~ppo"], "ppo"),
        (["ppo.epochs"], "Error parsing override 'ppo.epochs'"),
        # Values out of range, and absurd ones.
        (["ppo.epochs=0"], "ppo.epochs=0 must be at least 1"),
        (["ppo.steps=-1"], "ppo.steps=-1 must be at least 1"),
        (["ppo.steps=100000000"], "ppo.steps=100000000 must be at least 1 and at most 1e+06"),
        (["ppo.iterations=0"], "ppo.iterations=0 must be at least 1"),
        (["ppo.minibatch_size=0"], "ppo.minibatch_size=0 must be at least 1"),
        (["ppo.minibatch_size=9000"], "ppo.minibatch_size=9000 must be at most the 8192 frames"),
        (["ppo.cudagraphs=true"], "ppo.cudagraphs=True needs physics.device=cuda:0, not cpu"),
        (
            ["physics=warp", "ppo.cudagraphs=true", "ppo.minibatch_size=5000"],
            "ppo.minibatch_size=5000 must divide the 8192 frames",
        ),
        (["ppo.actor_lr=0"], "ppo.actor_lr=0.0 must be above 0"),
        (["ppo.gamma=1.5"], "ppo.gamma=1.5 must be at least 0 and at most 1"),
        (["ppo.clip_epsilon=1"], "ppo.clip_epsilon=1.0 must be above 0 and at most 0.99"),
        (["env.num_envs=0"], "env.num_envs=0 must be at least 1"),
        (["env.num_envs=-1"], "env.num_envs=-1 must be at least 1"),
        (["env.num_envs=10000000"], "env.num_envs=10000000 must be at least 1 and at most 1e+06"),
        (["env.num_envs=1000000", "ppo.steps=1000"], "must be at most 134217728 frames in an"),
        (["env.target_limit=1.1"], "env.target_limit=1.1 must be above 0 and at most 1.0472"),
        (["env.time_limit=nan"], "env.time_limit=nan must be above 0"),
        (["env.time_limit=0.1"], "env.time_limit=0.1 must be at least 0.25, one action"),
        (["env.settle_time=-1"], "env.settle_time=-1.0 must be at least 0"),
        (["env.control_frequency=inf"], "env.control_frequency=inf must be above 0"),
        (["physics.timestep=0"], "physics.timestep=0.0 must be above 0"),
        (["physics.timestep=0.03"], "physics.timestep=0.03 must divide the control period of 0.25"),
        (["physics.timestep=0.5"], "physics.timestep=0.5 must divide the control period of 0.25"),
        (["physics.timestep=1e-9"], "physics.timestep=1e-09 must be at least a millionth of"),
        (["physics.threads=0"], "physics.threads=0 must be at least 1"),
        (["physics.device=cuda:0"], "physics.device=cuda:0 must be cpu with physics=threaded"),
        (["physics.contacts=9"], "physics.contacts=9 must be null with physics=threaded"),
        (["physics=warp", "physics.device=gpu"], "physics.device=gpu must be cpu, cuda:0"),
        (["physics=warp", "physics.threads=2"], "physics.threads=2 must be null with physics=warp"),
        (["physics=warp", "physics.contacts=0"], "physics.contacts=0 must be at least 1"),
        (["physics=warp", "physics.device=cuda:999"], "physics.device=cuda:999 is not there"),
        (["--multirun", "physics=threaded,warp", "physics.device=cuda:999"], "physics.device=cuda"),
        (["physics.stiffness=-2"], "physics.stiffness=-2.0 must be above 0"),
        (["obs.hinge_steps=0"], "obs.hinge_steps=0 must be at least 1"),
        (["seed=-1"], "seed=-1 must be at least 0"),
        (["checkpoint_interval=0"], "checkpoint_interval=0 must be at least 1"),
        (["robot.name=a/b"], "robot.name='a/b' must be a non-empty name without '/'"),
        # Sweeps, folders.
        (["robot=gecko,ant"], "robot=gecko,ant: several values need --multirun"),
        (["--multirun", "seed=0,1,-2"], "seed=-2 must be at least 0"),
        (["--multirun", "robot=gecko,lizard"], "robot=lizard is unknown"),
        (["--config-dir=nowhere"], "--config-dir=nowhere is no folder"),
        (["hydra.run.dir=/dev/null/run"], "/dev/null/run cannot be written: Not a directory"),
        (["hydra.run.dir=/proc/run"], "/proc/run cannot be written"),
        (["--multirun", "seed=0,1", "hydra.sweep.dir=/proc/run"], "/proc/run/0 cannot be written"),
        # Bodies.
        (["robot.body.module=wheel"], f"{GECKO}: unknown module 'wheel'; choose from core, brick"),
        (["robot.body.children.back.rotation=30"], f"{GECKO}/back: rotation 30 is no quarter turn"),
        (["+robot.body.children.top={module: hinge}"], f"{GECKO}: a core has no face 'top'"),
        (["+robot.body.colour=red"], f"{GECKO}: unknown key 'colour'; allowed are module"),
        # Code in a configuration.
        (["+_target_=os.system"], "_target_ is no key"),
        (["+robot._target_=os.system"], "robot._target_ is no key"),
        (["+robot.body._target_=os.system"], f"{GECKO}: unknown key '_target_'"),
        (
            ["+hydra.callbacks.x._target_=os.system"],
            "hydra.callbacks.x._target_=os.system is fixed",
        ),
        (["hydra.launcher._target_=os.system"], "hydra.launcher._target_=os.system is fixed"),
        (["hydra/launcher=parallel", "hydra.launcher.temp_folder=x"], "launcher.temp_folder=x is"),
        (["hydra/job_logging=default"], "hydra.job_logging"),
        (["++hydra.job_logging.handlers.x.class=logging.FileHandler"], "FileHandler is fixed"),
        (["--help", "++hydra.hydra_logging.handlers.x.filename=y"], "hydra.hydra_logging"),
        (["+hydra.job.env_set.LD_PRELOAD=x.so"], "hydra.job.env_set"),
        (["hydra.verbose=true"], "hydra.verbose=True is fixed; it stays False"),
        (["hydra.output_subdir=x"], "hydra.output_subdir=x is fixed; it stays None"),
        (["--experimental-rerun=job.pickle"], "use resume=FOLDER"),
        (["--config-path=x"], "--config-path has no meaning here; use --config-dir"),
        (["--config-name=x"], "--config-name has no meaning here; use --config-dir"),
        # Flags.
        (["--bogus"], "unrecognized arguments: --bogus"),
        (["--cfg=bogus"], "argument --cfg/-c: invalid choice: 'bogus'"),
        (["--cfg=job", "--multirun"], "--multirun goes neither with --cfg nor with --run"),
        (["--resolve"], "--resolve and --package go with --cfg"),
        ([f"hydra.run.dir={'x' * 300}"], "cannot be written: File name too long"),
    ],
)
def test_a_wrong_call_ends_in_one_line(arguments, message, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert message in refusal(arguments, monkeypatch, capsys)
    assert not list(tmp_path.iterdir())


def test_packages_that_are_missing_are_named(monkeypatch, capsys):
    monkeypatch.setattr(schema.importlib.util, "find_spec", lambda name: None)
    line = refusal(["physics=warp", "physics.device=cpu"], monkeypatch, capsys)
    assert line == "error: physics=warp needs packages: pip install 'locomotion[warp]'\n"


@pytest.fixture
def interrupted(tmp_path):
    """The folder of a run that has not come far."""
    folder = tmp_path / "run"
    record(folder, config=OmegaConf.structured(compose("+obs=history3", "ppo.iterations=50")))
    (folder / "metrics.csv").write_text("iteration,frames,mean_reward,mean_value\n")
    return folder


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["robot=ant"], "robot.name=ant would change the run in"),
        (["+obs=hinges"], "obs.hinge_steps=1 would change the run in"),
        (["seed=1"], "seed=1 would change the run in {run}, which has seed=0"),
        (
            ["ppo.gamma=0.9"],
            "ppo.gamma=0.9 would change the run in {run}, which has ppo.gamma=0.99",
        ),
        (["ppo.iterations=49"], "ppo.iterations=49 must be at least the 50 of the run"),
        (["ppo.epochs=0"], "ppo.epochs=0 must be at least 1"),
        (["ppo.iteration=60"], "ppo.iteration is no key; did you mean ppo.iterations?"),
        (["logger=paper"], "logger=paper is unknown; choose from csv, tensorboard, wandb"),
        (["physics.threads=many"], "physics.threads"),
        (["hydra.run.dir=x"], "hydra.run.dir=x has no meaning beside resume=FOLDER"),
        (["seed=0,1"], "seed=0,1 has no meaning beside resume=FOLDER"),
        (["~seed"], "~seed has no meaning beside resume=FOLDER"),
        (["ppo.iterations"], "Error parsing override 'ppo.iterations'"),
        (["--multirun"], "resume=FOLDER goes on with one run; a sweep goes on when started again"),
        (["--help"], "resume=FOLDER goes with KEY=VALUE, and with no flag"),
        (["seed=abc"], "seed"),
        (["env=abc"], "env"),
        (["checkpoint_interval=abc"], "checkpoint_interval"),
        (
            ["logger=../logger/csv"],
            "logger=../logger/csv is unknown; choose from csv, tensorboard, wandb",
        ),
        (["resume=other"], "resume names several folders; a command goes on with one run"),
    ],
)
def test_what_would_change_a_resumed_run_is_refused(
    interrupted, arguments, message, monkeypatch, capsys
):
    before = {path: path.read_bytes() for path in interrupted.rglob("*") if path.is_file()}
    line = refusal([f"resume={interrupted}", *arguments], monkeypatch, capsys)
    assert message.format(run=interrupted) in line
    assert {path: path.read_bytes() for path in interrupted.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (None, "holds no .hydra/config.yaml, so it is no run's folder"),
        ("", "robot"),
        ("- a list", "holds no configuration"),
        ("robot: [", "cannot be read"),
        ("robot: ${nowhere}", "cannot be read"),
        ("_target_: os.system", "_target_ is no key"),
        ("seed: !!python/object/apply:os.mkdir [crater]", "cannot be read"),
        ("seed: many", "seed"),
        ("&a [*a]", ""),
        ("[" * 3000, ""),
        ("seed: \x07", "cannot be read"),
    ],
)
def test_what_is_no_run_is_not_resumed(config, message, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    if config is not None:
        (tmp_path / "run" / ".hydra").mkdir(parents=True)
        (tmp_path / "run" / ".hydra" / "config.yaml").write_text(config)
    assert message in refusal(["resume=run"], monkeypatch, capsys)
    assert not (tmp_path / "crater").exists()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root writes anywhere")
def test_a_run_that_cannot_be_written_is_named(interrupted, monkeypatch, capsys):
    interrupted.chmod(0o555)
    try:
        line = refusal([f"resume={interrupted}"], monkeypatch, capsys)
    finally:
        interrupted.chmod(0o755)
    assert line == f"error: {interrupted} cannot be written: Permission denied\n"


BODY_FILES = {
    "name: twin\nbody:\n  module: core\n  children:\n    left:\n      module: brick\n      children:\n"
    "        front: {module: hinge}\n        front: {module: brick}\n": (
        "core/left: two children on the face 'front'"
    ),
    "name: red\nbody: {module: core}\ncolour: red\n": "robot.colour is no key; allowed are name, body",
    "name: red\n": "robot.body",
    "body: {module: core, children: {left: {module: hinge}}}\n": "robot.name",
    "name: red\nbody: core\n": "robot.body",
    "name: red\nbody: {module: core, children: [hinge]}\n": "core: children must map faces",
    "name: red\nbody: {module: core}\n": "core: the body has no hinge",
    "name: [\n": "red.yaml, line 2",
    "name: red\nbody: {module: core, children: {left: {module: hinge, children: {attachment: "
    "{module: core}}}}}\n": "core/left/attachment: a body has one core",
    "defaults: [{x: y}]\nname: red\n": "x",
    "name: red\nhydra: {callbacks: {x: {_target_: os.system}}}\n": "no key",
    "# @package _global_\nhydra: {callbacks: {x: {_target_: os.system}}}\n": "os.system is fixed",
    "# @package _global_\nhydra: {job_logging: {handlers: {file: {filename: crater}}}}\n": "is fixed",
    "name: \x07": "special characters are not allowed",
}


@pytest.mark.parametrize("content", BODY_FILES)
def test_a_faulty_body_file_is_named(content, monkeypatch, capsys, tmp_path):
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot" / "red.yaml").write_text(content)
    line = refusal([f"--config-dir={tmp_path}", "robot=red"], monkeypatch, capsys)
    assert BODY_FILES[content] in line


@pytest.mark.parametrize(
    ("pairs", "message"), [(20, "more than 40 modules"), (100, "nested too deeply")]
)
def test_a_body_without_end_is_refused(pairs, message, monkeypatch, capsys, tmp_path):
    body = "{module: hinge}"
    for _ in range(pairs):
        brick = f"{{module: brick, children: {{front: {body}}}}}"
        body = f"{{module: hinge, children: {{attachment: {brick}}}}}"
    (tmp_path / "robot").mkdir()
    text = f"name: tower\nbody: {{module: core, children: {{front: {body}}}}}\n"
    (tmp_path / "robot" / "tower.yaml").write_text(text)
    line = refusal([f"--config-dir={tmp_path}", "robot=tower"], monkeypatch, capsys)
    assert message in line


def test_a_folder_of_ones_own_may_have_any_name(monkeypatch, capsys, tmp_path):
    folder = tmp_path / "a,b (c) [d]"
    (folder / "robot").mkdir(parents=True)
    body = "{module: core, children: {front: {module: hinge}}}"
    (folder / "robot" / "red.yaml").write_text(f"name: red\nbody: {body}\n")
    line = refusal([f"--config-dir={folder}", "robot=red", "seed=-1"], monkeypatch, capsys)
    assert line.startswith("error: seed=-1 must be")
    other = tmp_path / "other"
    other.mkdir()
    search = f"hydra.searchpath=['file://{other}']"
    arguments = [f"--config-dir={folder}", "robot=red", search, "seed=-1"]
    assert refusal(arguments, monkeypatch, capsys).startswith("error: seed=-1 must be")
