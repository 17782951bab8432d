"""Small runs, and the environment stepped by hand."""

import csv

import pytest
import torch
from tensordict import TensorDict

from locomotion import compose
from locomotion.envs import LocomotionEnv

ROBOTS, STEPS = 5, 12
SMALL = (
    f"env.num_envs={ROBOTS}",
    f"ppo.steps={STEPS}",
    "ppo.minibatch_size=30",
    "ppo.iterations=3",
    "physics.threads=1",
)


@pytest.fixture
def configured():
    """The configuration of a small run: five Geckos, three iterations of twelve steps."""
    return lambda *overrides: compose(*SMALL, *overrides)


@pytest.fixture
def rows():
    """Reads a run's metrics, timings aside."""

    def read(folder):
        with (folder / "metrics.csv").open() as file:
            return [
                {key: float(x) for key, x in row.items() if not key.endswith("_seconds")}
                for row in csv.DictReader(file)
            ]

    return read


class Keeping:
    """A learner that keeps what another one learns from."""

    def __init__(self, learner):
        self.learner = learner
        self.policy = learner.policy
        self.batches = []

    def update(self, batch):
        self.batches.append(batch.clone())
        return self.learner.update(batch)

    def state_dict(self):
        return self.learner.state_dict()

    def load_state_dict(self, state_dict):
        self.learner.load_state_dict(state_dict)


@pytest.fixture
def keeping():
    return Keeping


@pytest.fixture
def stepped_by_hand():
    """Geckos that take given actions, stepped and reset without transforms and collectors.

    Args:
        actions: shape ``(robots, steps, hinges)``.
        time_limit: of an episode (s).
        make: makes the environment, with ``num_envs`` and options as :class:`LocomotionEnv` has them.

    Returns:
        What the robots sense before the steps, and what there is after them; shape ``(robots, steps)``.
    """

    def step_all(actions, time_limit=None, make=LocomotionEnv, **options):
        env = make(
            "gecko", len(actions), time_limit=time_limit, seed=0, physics={"threads": 1}, **options
        )
        now, before, after = env.reset(), [], []
        for action in actions.unbind(1):
            before.append(now.clone())
            after.append(env.step(now.set("action", action))["next"])
            done = after[-1]["done"]
            now = after[-1].exclude("reward").clone()
            if done.any():
                fresh = env.reset(TensorDict({"_reset": done}, [len(done)]))
                now = torch.where(done.squeeze(-1), fresh, now)
        return torch.stack(before, 1), torch.stack(after, 1)

    return step_all
