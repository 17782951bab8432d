"""Policies outside the simulator do what they do inside."""

import json
import math
import os
import runpy
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import onnxruntime
import pytest
import torch
from torchrl.envs import ExplorationType, set_exploration_type

from locomotion import compose
from locomotion.export import ExportConfig, export
from locomotion.runs.checkpoints import Checkpoints
from locomotion.training.build import make_env, make_learner

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).parents[2] / "docs" / "walk_without_torch.py"
TERMS = {
    "mixed": """
        slow: {reading: hinge_velocity, scale: 0.1, steps: 3}
        hinge_target: {steps: 2}
        down: {reading: core_orientation, representation: gravity}
        phase_clock: {}
        """,
    "moving": """
        forward: {reading: core_orientation, representation: yaw, steps: 2}
        core_orientation: {representation: rotation_6d, scale: 2}
        core_linear_velocity: {}
        core_angular_velocity: {scale: 0.2}
        core_height: {scale: 10, steps: 2}
        """,
    "walker": """
        hinge_position: {steps: 2}
        hinge_velocity: {scale: 0.1}
        hinge_target: {}
        core_orientation: {representation: gravity}
        core_angular_velocity: {}
        core_linear_velocity: {}
        core_height: {}
        phase_clock: {}
        """,
}


@pytest.fixture
def exported(tmp_path, capsys):
    """Exports an untrained policy in all formats; gives its environment, itself, and the files."""

    def make(*overrides):
        (tmp_path / "obs").mkdir()
        for name, terms in TERMS.items():
            (tmp_path / "obs" / f"{name}.yaml").write_text(terms)
        torch.manual_seed(0)
        small = ("env.num_envs=1", "ppo.steps=2", "ppo.minibatch_size=1")
        config = compose(*small, *overrides, config_dir=tmp_path)
        env = make_env(config)
        policy = make_learner(config, env).policy
        for parameter in policy.parameters():
            parameter.data *= 2  # so that some actions are clipped
        Checkpoints(tmp_path, policy=policy).save(1)
        files = [tmp_path / f"gait{ending}" for ending in (".onnx", ".pt2", ".xml")]
        for file in files:
            export(tmp_path, config, ExportConfig(str(file)))
        assert capsys.readouterr().out.split() == list(map(str, files))
        return env, policy, files

    return make


@pytest.mark.parametrize(
    ("overrides", "memory"),
    [
        (["+obs=history3"], ["hinge_position_history"]),
        (["+obs=hinges_orientation", "robot=ant"], []),
        (["obs=mixed", "env.control_frequency=5"], ["slow_history", "hinge_target_history"]),
        (["obs=moving", "env.target_limit=0.2"], ["forward_history", "core_height_history"]),
        (["network=gru"], ["recurrent_state"]),
        (
            ["obs=history3_targets", "env.target_limit=0.2"],
            ["hinge_position_history", "hinge_target_history"],
        ),
        (["obs=targets3_gyro"], ["hinge_target_history"]),
        (
            ["algorithm=cpg", "env.num_envs=64", "env.control_frequency=5", "cpg.steps=100"],
            ["oscillators"],
        ),
        (
            ["network=gru", "network.layers=2", "obs=mixed", "env.control_frequency=10"],
            ["slow_history", "hinge_target_history", "recurrent_state"],
        ),
    ],
)
def test_the_exported_policy_acts_as_the_original(overrides, memory, exported):
    env, policy, (onnx, pt2, _) = exported(*overrides)
    base = env.base_env
    with set_exploration_type(ExplorationType.DETERMINISTIC), torch.no_grad():
        walked = env.rollout(12, policy)

    session = onnxruntime.InferenceSession(onnx)
    metadata = {
        "robot": base.task.robot.mjcf_model.model,
        "control_frequency": f"{1 / base.task.control_timestep:g}",
        "clock_frequency": "1",
        "hinges": json.dumps(base.hinge_names),
        "memory": json.dumps(memory),
    }
    assert session.get_modelmeta().custom_metadata_map == metadata
    found = dict.fromkeys(metadata, "")
    program = torch.export.load(pt2, extra_files=found).module()
    assert found == metadata
    assert [value.name for value in session.get_outputs()] == [
        f"next_{name}" for name in ("hinge_target", *memory)
    ]

    sizes = {value.name: value.shape for value in session.get_inputs()}
    assert sizes.keys() == {*base.observation_spec.keys(), *memory}
    kept = {name: np.zeros(sizes[name], np.float32) for name in memory}
    limit, clipped = base.task.target_limit, False
    for step in range(12):
        readings = {name: walked[name][0, step] for name in sizes if name not in memory}
        # The order of entries does not matter.
        given = {name: torch.tensor(kept[name]) for name in reversed(memory)}
        targets, following = program(dict(reversed(readings.items())), given)
        action, *new = session.run(None, {name: x.numpy() for name, x in readings.items()} | kept)
        original = walked["action"][0, step].clamp(-limit, limit)
        np.testing.assert_allclose(action, original, atol=1e-5)
        np.testing.assert_allclose(targets.detach(), original, atol=1e-5)
        kept = dict(zip(memory, new, strict=True))
        for name, value in kept.items():
            np.testing.assert_allclose(following[name].detach(), value, atol=1e-5)
        clipped |= bool((walked["action"][0, step].abs() > limit).any())
    assert clipped or "oscillators" in memory  # which are clipped before
    assert all(np.any(value) for value in kept.values())


def test_a_robot_alone_is_written_without_its_policy(exported):
    env, _, (_, _, xml) = exported(
        "network=gru", "disturbances.latency=0.1", "physics.friction=0.7"
    )
    ours, theirs = env.base_env.model, mujoco.MjModel.from_xml_path(str(xml))
    for name in ("body_mass", "pair_friction", "actuator_delay", "actuator_gainprm", "qpos0"):
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name))
    assert theirs.opt.timestep == ours.opt.timestep


def test_a_gait_that_ships_walks_without_torch(command, tmp_path):
    assert command("export", "robot=gecko", cwd=tmp_path).returncode == 0
    (tmp_path / "torch.py").write_text("raise ImportError('torch must not be needed')")
    result = subprocess.run(
        [sys.executable, SCRIPT, "gecko.onnx", "gecko.xml"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert result.returncode == 0, result.stderr
    assert float(result.stdout.split()[0]) > 7


def test_the_script_without_torch_reads_what_the_environment_reads(exported, monkeypatch):
    env, _, (onnx, _, xml) = exported("obs=walker", "network=gru", "env.clock_frequency=0.33")
    monkeypatch.setattr(sys, "argv", ["walk", str(onnx), str(xml)])
    script = runpy.run_path(str(SCRIPT))
    data, read = script["data"], script["read"]()
    base = env.base_env
    assert data.time == pytest.approx(20)
    base.set_state(torch.tensor(data.qpos), torch.tensor(data.qvel))
    base.physics.control[:] = torch.tensor(data.ctrl)
    expected = base.observe()
    angle = 2 * math.pi * 0.33 * 20
    expected["phase_clock"] = torch.tensor([[math.cos(angle), math.sin(angle)]])
    for name, value in expected.items():
        np.testing.assert_allclose(read[name], value[0], atol=1e-5, err_msg=name)
    assert np.any(np.abs(read["core_linear_velocity"]) > 1e-4)
