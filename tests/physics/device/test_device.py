"""Robots, training and walks where a GPU would be: on a stand-in that refuses what a GPU refuses."""

import csv
import json

import pytest
import torch
from torch.utils._pytree import tree_map

from locomotion import compose, train
from locomotion.config import typed_config
from locomotion.envs import LocomotionEnv
from locomotion.evaluate import evaluate
from locomotion.evaluation import make_runner
from locomotion.evaluation.options import EvaluateConfig
from locomotion.evaluation.shipped import POLICIES
from locomotion.options import readings
from locomotion.rendering.motion import record_motion
from locomotion.runs import read_config
from locomotion.training.build import make_collector, make_env, make_learner

pytestmark = pytest.mark.slow

SMALL = [
    *("env.num_envs=4", "env.time_limit=2", "ppo.steps=8", "ppo.minibatch_size=16"),
    *("ppo.iterations=4", "checkpoint_interval=2", "physics=warp", "+obs=history3"),
]


@pytest.fixture
def placed(elsewhere):
    """Configurations of small runs, placed on the device."""
    device, _ = elsewhere

    def placed(*overrides):
        config = compose(*SMALL, *overrides)
        config.physics.device = str(device)  # which no configuration may name
        return config

    return placed


def collecting(config):
    env = make_env(config)
    learner = make_learner(config, env)
    return make_collector(env, learner, config.learner.steps), learner


def outcome(folder):
    """All that a run came to, but for its timings."""
    with (folder / "metrics.csv").open() as file:
        rows = [
            {name: value for name, value in row.items() if not name.endswith("_seconds")}
            for row in csv.DictReader(file)
        ]
    return rows, (folder / "checkpoints" / "000004.ckpt").stat().st_size


def test_the_stand_in_refuses_and_counts(elsewhere):
    device, crossings = elsewhere
    there, here = torch.arange(3.0, device=device), torch.arange(3.0)
    with pytest.raises(RuntimeError, match=r"add\.Tensor has tensors here and on lazy:0"):
        there + here
    assert (there + 1).device == device and not crossings
    assert (there.cpu() + here).tolist() == [0, 2, 4]
    assert crossings.total() == 1
    there[there != 1] = 7.0
    assert there.tolist() == [7, 1, 7] and there.sum().item() == 15
    assert crossings.total() == 4


def test_all_readings_and_rewards_stay_on_the_device(placed, elsewhere):
    device, crossings = elsewhere
    config = placed("task=walk_along", "disturbances.latency=0.1", "physics.self_collision=true")
    env = LocomotionEnv(
        make_env(config).base_env.task,
        4,
        readings=readings.names(),
        physics=config.physics,
        time_limit=1.0,
        seed=0,
    )
    rollout = env.rollout(6, break_when_any_done=False)
    action = torch.zeros(4, 6, device=device)
    td = env.reset().set("action", action)
    crossings.clear()
    env.step(td)
    # Once in each physics step, as work is looked at.
    assert crossings.total() == 25
    assert {value.device for value in rollout.flatten_keys().values()} == {device}
    state = env.state_dict()
    env.load_state_dict(tree_map(_on_the_cpu, state))
    td = env.rollout(1)[:, 0]["next"]
    env.physics.qvel[1, 3] = float("nan")
    td = env.step(td.set("action", action))["next"]
    assert td["terminated"].squeeze(-1).tolist() == [False, True, False, False]
    assert all(value.isfinite().all() for value in td.values())
    (divergence,) = env.take_divergences()
    assert divergence.robot == 1 and divergence.qvel.device.type == "cpu"


@pytest.mark.filterwarnings("ignore:This module is instantiated on a machine without CUDA")
@pytest.mark.parametrize("cudagraphs", [False, True])
def test_a_run_and_its_resumption_stay_on_the_device(cudagraphs, tmp_path, placed):
    config = placed()
    config.learner.cudagraphs = cudagraphs
    train(config, tmp_path / "whole")
    for part in ("checkpoints/000002.ckpt", "metrics.csv", ".hydra/config.yaml"):
        (tmp_path / "resumed" / part).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / "resumed" / part).write_bytes((tmp_path / "whole" / part).read_bytes())
    result = train(config, tmp_path / "resumed")
    assert not result.skipped
    assert outcome(tmp_path / "resumed") == outcome(tmp_path / "whole")


def test_a_policy_is_measured_and_filmed_on_the_device(elsewhere, capsys):
    device, _ = elsewhere
    content = read_config(POLICIES / "gecko")
    content["env"] |= {"num_envs": 2, "time_limit": None}
    content["physics"]["backend"] = "warp"
    content["disturbances"] = {"hinge_noise": 0.1, "push": 0.2}
    config = typed_config(content, learning=False)
    config.physics.device = str(device)
    options = EvaluateConfig(seconds=1.0, reality_check=False, json=True)
    evaluate(POLICIES / "gecko", config, options)
    assert 0 < json.loads(capsys.readouterr().out)["mean_action"]["speed"]["mean"] < 2
    motion = record_motion(make_runner(POLICIES / "gecko", config), seconds=1.0, fps=10)
    assert motion.qpos.shape == (10, motion.model.nq) and motion.speed > 0


@pytest.mark.parametrize("latency", [0.0, 0.1])
def test_a_control_step_waits_three_times_for_the_device(latency, placed, elsewhere):
    _, crossings = elsewhere
    collector, _ = collecting(placed("env.time_limit=null", f"disturbances.latency={latency}"))
    batches = iter(collector)
    next(batches)
    crossings.clear()
    batch = next(batches)
    assert batch["action"].shape == (4, 8, 6)
    assert crossings == {
        "aten._to_copy.default": 8,  # who is wrong or crowded
        "aten._local_scalar_dense.default": 16,  # TorchRL, twice: whether an episode has ended
    }


def test_a_gradient_step_never_waits_for_the_device(placed, elsewhere):
    _, crossings = elsewhere
    config = placed()
    collector, learner = collecting(config)
    batch, waits = next(iter(collector)), []
    learner.update(batch)  # makes room for batches
    for resumed in (False, True):
        if resumed:  # a checkpoint is read on the CPU
            learner.load_state_dict(tree_map(_on_the_cpu, learner.state_dict()))
        for config.learner.epochs in (1, 3):
            crossings.clear()
            learner.update(batch)
            waits.append(crossings.total())
    assert len(set(waits)) == 1


def _on_the_cpu(value):
    return value.cpu() if isinstance(value, torch.Tensor) else value
