"""``locomotion COMMAND`` is ``python -m locomotion.COMMAND``."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

COMMANDS = ["train", "evaluate", "watch", "export", "plot"]


@pytest.fixture(scope="module")
def script():
    """The script that pip writes for the entry point in ``pyproject.toml``."""
    project = tomllib.loads(Path(__file__).parents[2].joinpath("pyproject.toml").read_text("utf-8"))
    module, _, name = project["project"]["scripts"]["locomotion"].partition(":")
    code = (
        f"import sys; from {module} import {name}; sys.argv[0] = 'locomotion'; sys.exit({name}())"
    )
    return [sys.executable, "-c", code]


def run(*line, cwd):
    return subprocess.run([*map(str, line)], cwd=cwd, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize("command", ["train", "plot"])
def test_a_command_helps_under_either_name(command, script, tmp_path):
    whole = [sys.executable, "-m", f"locomotion.{command}", "--help"]
    helped = run(*whole, cwd=tmp_path)
    assert helped.returncode == 0 and "locomotion" in helped.stdout
    for line in ([*script, command, "--help"], [sys.executable, "-m", "locomotion", *whole[2:]]):
        line = [command if part == f"locomotion.{command}" else part for part in line]
        assert run(*line, cwd=tmp_path).stdout == helped.stdout


def test_a_sweep_with_processes_is_trained(script, small, tmp_path):
    sweep = ["--multirun", "hydra/launcher=parallel", "physics.threads=1", "seed=0,1"]
    result = run(*script, "train", *sweep, *small, "hydra.sweep.dir=sweep", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    names = sorted(path.parent.name for path in tmp_path.glob("sweep/*/learning_curve.png"))
    assert names == ["0", "1"]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ["fly"],
            "locomotion fly does nothing; choose from train, evaluate, robots, watch, export, plot",
        ),
        ([], "locomotion without a command does nothing; choose from train, evaluate"),
        (["train", "ppo.epochs=0"], "ppo.epochs=0 must be at least 1"),
        (["evaluate", "seconds=0"], "seconds=0.0 must be above 0"),
        (["plot", "nowhere"], "nowhere holds no metrics.csv, so it is not a run's folder"),
    ],
)
def test_a_mistake_ends_in_one_line(arguments, line, script, tmp_path):
    result = run(*script, *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr.startswith(f"error: {line}")
    assert (result.stdout, result.stderr.count("\n")) == ("", 1)


def test_it_lists_the_commands_without_loading_anything_heavy(tmp_path):
    code = (
        "import sys; sys.argv = ['locomotion', '--help']; from locomotion.__main__ import main;"
        "main(); print(*sorted({'torch', 'mujoco', 'matplotlib'} & {*sys.modules}))"
    )
    result = run(sys.executable, "-c", code, cwd=tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    lines = result.stdout.splitlines()
    assert all(any(line.startswith(f"  {name} ") for line in lines) for name in COMMANDS)
    assert lines[-1] == ""
