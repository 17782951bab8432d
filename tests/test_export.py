"""Policies outside the simulator do what they do inside."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch
from omegaconf import OmegaConf
from torchrl.envs import set_exploration_type
from torchrl.envs.utils import ExplorationType

from locomotion.assembly import make_env, make_policy
from locomotion.command_line.composing import compose
from locomotion.config import ExportConfig
from locomotion.export import export
from locomotion.runs import record
from locomotion.runs.checkpoints import Checkpoints

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    "overrides",
    [
        ("+obs=history3",),
        ("+obs=hinges_orientation", "robot=ant"),
        ("+obs=history3_hinges",),
        ("obs.orientation=rotation_6d", "obs.hinge_steps=2", "env.control_frequency=5"),
    ],
)
def test_the_exported_policy_acts_as_the_original(overrides, tmp_path, capsys):
    torch.manual_seed(0)
    config = compose("env.num_envs=1", "ppo.steps=1", "ppo.minibatch_size=1", *overrides)
    env = make_env(config)
    policy = make_policy(config, env)
    for parameter in policy.parameters():
        parameter.data *= 3  # so that some actions are clipped
    record(tmp_path, config=OmegaConf.structured(config))
    Checkpoints(tmp_path, actor=policy).save(1)
    files = [tmp_path / name for name in ("gait.onnx", "gait.pt2", "gait.xml")]
    for file in files:
        export(tmp_path, config, ExportConfig(str(file)))
    assert capsys.readouterr().out.split() == list(map(str, files))

    with set_exploration_type(ExplorationType.DETERMINISTIC), torch.no_grad():
        walked = env.rollout(12, policy)
    session = onnxruntime.InferenceSession(files[0])
    program = torch.export.load(files[1]).module()
    assert session.get_modelmeta().custom_metadata_map == {
        "robot": config.robot.name,
        "control_frequency": f"{config.env.control_frequency:g}",
        "hinges": '["' + '", "'.join(env.base_env.hinge_names) + '"]',
    }
    inputs = {value.name: np.zeros(value.shape, np.float32) for value in session.get_inputs()}
    assert ("core_orientation" in inputs) == (config.obs.orientation is not None)
    clipped = False
    for step in range(12):
        hinges = env.action_spec.shape[-1]
        inputs["hinge_position"] = walked["hinge_position_history"][0, step, :hinges].numpy()
        if "core_orientation" in inputs:
            inputs["core_orientation"] = walked["core_orientation"][0, step].numpy()
        given = {name: torch.tensor(value) for name, value in inputs.items()}
        targets, following = program(**given)
        action, inputs["history"] = session.run(None, inputs)
        original = walked["action"][0, step].clamp(-1, 1).numpy()
        np.testing.assert_allclose(action, original, atol=1e-5)
        np.testing.assert_allclose(targets.detach(), original, atol=1e-5)
        np.testing.assert_array_equal(following, inputs["history"])
        clipped |= bool(np.any(np.abs(walked["action"][0, step].numpy()) > 1))
    assert clipped


def test_a_gait_walks_without_torch(tmp_path):
    command = [sys.executable, "-m", "locomotion.export", "robot=gecko"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, timeout=300)
    (tmp_path / "torch.py").write_text("raise ImportError('torch must not be needed')")
    result = subprocess.run(
        [sys.executable, ROOT / "docs" / "walk_without_torch.py", "gecko.onnx", "gecko.xml"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert result.returncode == 0, result.stderr
    assert float(result.stdout.split()[0]) > 7


def test_without_onnx_the_line_says_what_to_install(monkeypatch, tmp_path, capsys):
    from locomotion import export as module

    found = module.importlib.util.find_spec
    monkeypatch.setattr(
        module.importlib.util, "find_spec", lambda name: None if name == "onnx" else found(name)
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["export"])
    with pytest.raises(SystemExit) as ended:
        module.main()
    assert ended.value.code == 2
    assert "pip install onnx onnxscript" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
