"""A mistake ends the command before torch is loaded, which takes seconds."""

import json
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

CODE = """
import json, sys
from locomotion.cli import training
sys.argv[:] = ["train", *json.loads(sys.argv[1])]
try:
    training.main()
finally:
    heavy = {"torch", "torchrl", "tensordict", "mujoco", "dm_control", "matplotlib"}
    print(*sorted(heavy & {*sys.modules}))
"""


def run(*arguments, cwd):
    line = [sys.executable, "-c", CODE, json.dumps(arguments)]
    return subprocess.run(line, cwd=cwd, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize(
    "arguments",
    [
        ["ppo.iteration=3"],
        ["ppo.epochs=0"],
        ["ppo.minibatch_size=9000"],
        ["robot=lizard"],
        ["robot.body.children.back.rotation=30"],
        ["obs.hinge_velocty.steps=2"],
        ["task.rewards.velocty.weight=2"],
        ["network.name=mpl"],
        ["arena.name=moon"],
        ["algorithm=best"],
        ["network=gru", "network.layers=0"],
        ["hydra/launcher=joblib"],
        ["+plugins=[no_such_module]"],
        ["--multirun", "robot=gecko,ant", "seed=0,-1"],
        ["+experiment=ablation", "robot=lizard"],
        ["resume=."],
        ["--bogus"],
    ],
)
def test_a_mistake_ends_in_one_line_before_torch(arguments, tmp_path):
    result = run(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stdout == "\n"
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("arguments", [["--help"], ["--cfg=job"], ["--info=searchpath"]])
def test_information_needs_no_torch(arguments, tmp_path):
    result = run(*arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[-1] == ""
    assert not list(tmp_path.iterdir())


def test_torch_is_seen_when_it_is_loaded(tmp_path):
    # What the other tests look for would be found.
    result = run("+plugins=[torch]", "seed=-1", cwd=tmp_path)
    assert result.returncode == 2
    assert "torch" in result.stdout.split()
