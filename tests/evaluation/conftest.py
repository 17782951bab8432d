import pytest
import torch

from locomotion import compose
from locomotion.config import typed_config
from locomotion.evaluation import PolicyRunner
from locomotion.evaluation.shipped import POLICIES
from locomotion.runs import read_config
from locomotion.training.build import make_env


class Scripted:
    """A policy that moves hinges in a sine, whatever they sense, and keeps what it is shown."""

    def __init__(self, amplitude, action_spec, step=1.0):
        self.amplitude, self.shape, self.step = amplitude, action_spec.shape, step
        self.seen, self.actions = [], []

    def __call__(self, tensordict):
        self.seen.append(tensordict["hinge_position"].clone())
        phase = self.step * len(self.seen) + torch.arange(self.shape[-1])
        self.actions.append((self.amplitude * torch.sin(phase)).expand(self.shape))
        return tensordict.set("action", self.actions[-1])


@pytest.fixture
def scripted():
    """Makes a runner whose robots are moved by a sine, and the policy that moves them."""

    def make(*overrides, amplitude=1.0, step=1.0, runner=PolicyRunner):
        overrides = ("env.num_envs=3", "ppo.minibatch_size=1", "physics.threads=1", *overrides)
        env = make_env(compose(*overrides))
        policy = Scripted(amplitude, env.action_spec, step)
        return runner(env, policy), policy

    return make


@pytest.fixture
def shipped_run():
    """The folder of a policy that ships, and the task it was trained on, for a number of robots."""

    def read(robot, num_envs, disturbances=None, **physics):
        folder = POLICIES / robot
        saved = read_config(folder)
        saved["env"] |= {"num_envs": num_envs, "time_limit": None, "stagger": False}
        saved["disturbances"] = disturbances or {}
        saved["physics"] |= {"threads": 1, **physics}
        return folder, typed_config(saved, learning=False)

    return read
