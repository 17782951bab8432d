"""Training where a GPU would be: on a stand-in that refuses what a GPU refuses."""

import json

import pytest
import torch
from torch.utils._pytree import tree_map

pytest.importorskip("warp", reason="needs packages: pip install -e '.[warp]'")

from stand_in import DEVICE, stand_in
from test_warp import GECKO, SMALL, task_of_gecko, train_whole_and_resumed

from benchmarks.kill_and_resume import outcome
from locomotion import train as training
from locomotion.agents import PPO, make_critic
from locomotion.assembly import make_env, make_policy, policy_keys
from locomotion.command_line.composing import compose
from locomotion.config import EvaluateConfig
from locomotion.evaluate import evaluate
from locomotion.gaits import make_walker
from locomotion.rendering.motion import record_motion


@pytest.fixture
def crossings(monkeypatch):
    with stand_in(monkeypatch) as counted:
        yield counted


def placed(*overrides):
    return compose(*SMALL, "+obs=history3", f"physics.device={DEVICE}", *overrides)


def learner(config):
    env = make_env(config)
    actor = make_policy(config, env)
    critic = make_critic(env.observation_spec, policy_keys(config)).to(config.physics.device)
    collector = training.make_collector(config, env, actor)
    return collector, PPO(actor, critic, 6, 32, config.ppo)


def test_the_stand_in_refuses_and_counts(crossings):
    there, here = torch.arange(3.0, device=DEVICE), torch.arange(3.0)
    with pytest.raises(RuntimeError, match=r"add\.Tensor has tensors here and on lazy:0"):
        there + here
    assert (there + 1).device == DEVICE and not crossings
    assert (there.cpu() + here).tolist() == [0, 2, 4]
    assert crossings.total() == 1
    there[there != 1] = 7.0
    assert there.tolist() == [7, 1, 7] and there.sum().item() == 15
    assert crossings.total() == 4


@pytest.mark.filterwarnings("ignore:This module is instantiated on a machine without CUDA")
@pytest.mark.parametrize("cudagraphs", [False, True])
def test_a_run_and_its_resumption_stay_on_the_device(cudagraphs, tmp_path, crossings):
    config = placed()
    config.ppo.cudagraphs = cudagraphs  # which no configuration says of such a device
    train_whole_and_resumed(config, tmp_path)
    assert outcome(tmp_path / "resumed") == outcome(tmp_path / "whole")


def test_a_policy_is_measured_and_filmed_on_the_device(crossings, capsys):
    config = task_of_gecko("env.num_envs=2", "physics=warp", f"physics.device={DEVICE}")
    options = EvaluateConfig(
        seconds=1.0, delay=1, noise=0.1, push=0.2, reality_check=False, json=True
    )
    evaluate(GECKO, config, options)
    assert 0 < json.loads(capsys.readouterr().out)["mean_action"]["speed"]["mean"] < 2
    motion = record_motion(make_walker(GECKO, config), seconds=1.0, fps=10)
    assert motion.qpos.shape == (10, motion.model.nq) and motion.speed(9) > 0


def test_a_control_step_waits_once_for_the_device(crossings):
    collector, _ = learner(placed("env.time_limit=null"))
    batches = iter(collector)
    next(batches)
    crossings.clear()
    batch = next(batches)
    assert batch["action"].shape == (4, 8, 6)
    assert crossings == {"aten._to_copy.default": 8}  # who is wrong or crowded


def test_a_gradient_step_never_waits_for_the_device(crossings):
    collector, ppo = learner(placed())
    batch, waits = next(iter(collector)), []
    ppo.update(batch)  # makes room for batches
    for resumed in (False, True):
        if resumed:  # a checkpoint is read on the CPU
            ppo.load_state_dict(tree_map(_on_the_cpu, ppo.state_dict()))
        for ppo.epochs in (1, 5):
            crossings.clear()
            ppo.update(batch)
            waits.append(crossings.total())
    assert len(set(waits)) == 1


def _on_the_cpu(value):
    return value.cpu() if isinstance(value, torch.Tensor) else value
