"""``resume=FOLDER`` with what is not a run, or with what would change the run."""

import os

import pytest

from locomotion import compose
from locomotion.config import as_dict
from locomotion.runs import record

pytestmark = pytest.mark.slow


@pytest.fixture
def interrupted(tmp_path):
    """The folder of a run that has not come far."""
    folder = tmp_path / "run"
    record(folder, config=as_dict(compose("+obs=history3", "ppo.iterations=50")))
    (folder / "metrics.csv").write_text("iteration,frames,mean_reward,mean_value\n")
    return folder


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["robot=ant"], "robot.name=ant would change the run in"),
        (["+obs=hinges"], "obs.hinge_position.steps=1 would change the run in"),
        # What is left when terms are taken away would be the same if the choice were merged.
        (["obs=history3_hinges"], "no obs.core_orientation.reading would change the run in"),
        (["task=walk_along"], "task.rewards.velocity.weight=1.0 would change the run in"),
        (["network=gru"], "network.name=gru would change the run in"),
        (["seed=1"], "seed=1 would change the run in {run}, which has seed=0"),
        (
            ["ppo.gamma=0.9"],
            "ppo.gamma=0.9 would change the run in {run}, which has ppo.gamma=0.99",
        ),
        (["ppo.iterations=49"], "ppo.iterations=49 must be at least the 50 of the run"),
        (["ppo.epochs=0"], "ppo.epochs=0 must be at least 1"),
        (["ppo.iteration=60"], "ppo.iteration is not a key; did you mean ppo.iterations?"),
        (["logger=paper"], "logger=paper is unknown; choose from csv, tensorboard, wandb"),
        (["logger=../logger/csv"], "logger=../logger/csv is unknown; choose from csv"),
        (["physics.threads=many"], "physics.threads"),
        (["seed=abc"], "seed"),
        (["env=abc"], "str is not a subclass of EnvConfig"),
        (["checkpoint_interval=abc"], "checkpoint_interval"),
        (["hydra.run.dir=x"], "hydra.run.dir=x has no meaning with resume=FOLDER"),
        (["seed=0,1"], "seed=0,1 has no meaning with resume=FOLDER"),
        (["~seed"], "~seed has no meaning with resume=FOLDER"),
        (["ppo.iterations"], "ppo.iterations is not KEY=VALUE"),
        (["--multirun"], "resume=FOLDER resumes one run, with KEY=VALUE and without flags"),
        (["--help"], "resume=FOLDER resumes one run, with KEY=VALUE and without flags"),
        (["--config-dir=."], "resume=FOLDER resumes one run, with KEY=VALUE and without flags"),
        (["resume=other"], "resume=FOLDER resumes one run"),
    ],
)
def test_what_would_change_a_resumed_run_is_refused(interrupted, arguments, message, refusal):
    before = {path: path.read_bytes() for path in interrupted.rglob("*") if path.is_file()}
    assert message.format(run=interrupted) in refusal(f"resume={interrupted}", *arguments)
    assert {path: path.read_bytes() for path in interrupted.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (None, "holds no .hydra/config.yaml, so it is not a run's folder"),
        ("", "robot"),
        ("- a list", "holds no configuration"),
        ("robot: [", "cannot be read"),
        ("robot: ${nowhere}", "cannot be read"),
        ("_target_: os.system", "_target_ is not a key"),
        ("seed: !!python/object/apply:os.mkdir [crater]", "cannot be read"),
        ("seed: many", "seed"),
        ("algorithm: [ppo]", "algorithm=['ppo'] is unknown; did you mean ppo?"),
        ("logger: 3", "int is not a subclass of LoggerConfig"),
        ("&a [*a]", ""),
        ("[" * 3000, ""),
        ("seed: \x07", "cannot be read"),
    ],
)
def test_what_is_not_a_run_is_not_resumed(config, message, refusal, write, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if config is not None:
        write("run/.hydra/config.yaml", config)
    assert message in refusal("resume=run")
    assert not (tmp_path / "crater").exists()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root writes anywhere")
def test_a_run_that_cannot_be_written_is_named(interrupted, refusal):
    interrupted.chmod(0o555)
    try:
        line = refusal(f"resume={interrupted}")
    finally:
        interrupted.chmod(0o755)
    assert line == f"{interrupted} cannot be written: Permission denied"
