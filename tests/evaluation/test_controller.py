"""A controller around a policy of somebody's own."""

import pytest
import torch
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import nn
from torchrl.envs import InitTracker
from torchrl.modules import GRUModule, LSTMModule

from locomotion import compose
from locomotion.evaluation import Controller
from locomotion.training.build import make_env


@pytest.mark.filterwarnings("ignore:(?s).*_flat_weights.* were assigned during export")
@pytest.mark.parametrize("module", [GRUModule, LSTMModule])
def test_a_recurrent_policy_of_torchrls_parts_keeps_its_memory_outside(module):
    torch.manual_seed(0)
    parts = ["a", "b"][: 1 if module is GRUModule else 2]
    memory = module(
        input_size=6,
        hidden_size=5,
        num_layers=2,
        in_keys=["hinge_position", *parts],
        out_keys=["features", *(("next", part) for part in parts)],
    )
    head = TensorDictModule(nn.Linear(5, 6), ["features"], ["action"])
    policy = TensorDictSequential(memory, head).requires_grad_(False)
    config = compose("obs=hinges", "env.num_envs=1", "ppo.minibatch_size=1")
    env = make_env(config, transforms=[InitTracker(), memory.make_tensordict_primer()])
    walked = env.rollout(6, policy)

    controller = Controller(config, env, policy)
    assert controller.readings == {"hinge_position": 6}
    assert controller.memory == dict.fromkeys(parts, (2, 5))
    kept = {name: torch.zeros(shape) for name, shape in controller.memory.items()}
    readings = {"hinge_position": torch.zeros(6)}
    program = torch.export.export(controller, (readings, kept), strict=False).module()
    for step in range(6):
        targets, kept = program({"hinge_position": walked["hinge_position"][0, step]}, kept)
        expected = walked["action"][0, step].clamp(-1, 1)
        torch.testing.assert_close(targets, expected, atol=1e-5, rtol=0)
    assert all(part.any() for part in kept.values())
