"""Environments whose every number is known, and the definition of a history."""

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import Binary, Composite, Unbounded
from torchrl.envs import EnvBase


class Counting(EnvBase):
    """Robots whose episodes last as many steps as they are told, and whose angles are all different.

    Args:
        lengths: steps of an episode, a number for each robot.
        others: what robots that are not reset see in a partial reset; ``None``: what they see anyway.
    """

    def __init__(self, lengths, others=None):
        super().__init__(batch_size=[len(lengths)])
        self.lengths = torch.tensor(lengths)
        self.others = others
        self.ages = torch.zeros(len(lengths), dtype=torch.int64)
        self.seen = torch.zeros(len(lengths), dtype=torch.float64)
        shape = (len(lengths),)
        self.observation_spec = Composite(
            angle=Unbounded((*shape, 2), dtype=torch.float64),
            speed=Unbounded((*shape, 3), dtype=torch.float64),
            shape=shape,
        )
        self.action_spec = Unbounded((*shape, 1))
        self.reward_spec = Unbounded((*shape, 1))

    def observe(self):
        self.seen += 1
        angle = torch.stack([torch.arange(len(self.seen)) + 1 + self.seen / 100, -self.seen], -1)
        return angle, angle.mean(-1, keepdim=True) * torch.tensor([1.0, 2.0, 3.0])

    def _reset(self, tensordict=None):
        where = None if tensordict is None else tensordict.get("_reset", None)
        where = torch.ones_like(self.ages).bool() if where is None else where.reshape(-1)
        self.ages[where] = 0
        angle, speed = self.observe()
        if self.others is not None:
            angle[~where] = self.others
        done = torch.zeros(len(self.ages), 1, dtype=torch.bool)
        found = {"angle": angle, "speed": speed, "done": done, "terminated": done.clone()}
        return TensorDict(found, self.batch_size)

    def _step(self, tensordict):
        self.ages += 1
        angle, speed = self.observe()
        done = (self.ages >= self.lengths)[:, None]
        reward = tensordict["action"] + speed[:, :1].float()
        found = {"angle": angle, "speed": speed, "reward": reward}
        return TensorDict({**found, "done": done, "terminated": done.clone()}, self.batch_size)

    def _set_seed(self, seed):
        pass


class Agents(EnvBase):
    """Agents in groups, each with episodes of its own.

    Args:
        lengths: steps of an episode, for each agent of each group.
        together: whether a group has a flag of its own too, which is raised with that of its first
            agent; then all agents of the group are reset together.
    """

    def __init__(self, lengths, together=False):
        self.lengths = torch.tensor(lengths)
        self.together = together
        groups, agents = self.lengths.shape
        super().__init__(batch_size=[groups])
        self.ages = torch.zeros_like(self.lengths)
        self.seen = 0.0
        shape = (groups, agents)
        self.observation_spec = Composite(
            agents=Composite(angle=Unbounded((*shape, 2)), size=Unbounded(shape), shape=shape),
            shape=(groups,),
        )
        self.action_spec = Composite(
            agents=Composite(action=Unbounded((*shape, 1)), shape=shape), shape=(groups,)
        )
        self.reward_spec = Composite(
            agents=Composite(reward=Unbounded((*shape, 1)), shape=shape), shape=(groups,)
        )
        flags = {name: Binary(1, (*shape, 1), dtype=torch.bool) for name in ("done", "terminated")}
        own = {name: Binary(1, (groups, 1), dtype=torch.bool) for name in flags} if together else {}
        self.done_spec = Composite(agents=Composite(flags, shape=shape), **own, shape=(groups,))

    def result(self, done, **more):
        self.seen += 1
        angle = torch.arange(1.0, 1 + self.ages.numel()).reshape(self.ages.shape)
        angle = torch.stack([angle + self.seen / 100, -angle * self.seen], -1)
        flags = {"done": done, "terminated": done.clone()}
        seen = {"angle": angle, "size": angle[..., 0].clone()}
        inside = TensorDict({**seen, **flags, **more}, self.ages.shape)
        own = {name: flag[:, 0] for name, flag in flags.items()} if self.together else {}
        return TensorDict({"agents": inside, **own}, self.batch_size)

    def _reset(self, tensordict=None):
        key = "_reset" if self.together else ("agents", "_reset")
        where = None if tensordict is None else tensordict.get(key, None)
        if where is None:
            self.ages.zero_()
        else:  # a flag for each group, or for each agent
            self.ages[(where if self.together else where[..., 0]).expand_as(self.ages)] = 0
        return self.result(torch.zeros(*self.ages.shape, 1, dtype=torch.bool))

    def _step(self, tensordict):
        self.ages += 1
        done = (self.ages >= self.lengths)[..., None]
        return self.result(done, reward=tensordict["agents", "action"].clone())

    def _set_seed(self, seed):
        pass


def histories(values, starts, steps):
    """The definition, element by element: the value at t - k, or zero before the episode's start.

    Args:
        values: shape ``(rows, time, n)``.
        starts: whether an episode starts there, shape ``(rows, time)``.
        steps: how many values.
    """
    rows, time, size = values.shape
    expected = torch.zeros(rows, time, steps, size, dtype=values.dtype)
    for row in range(rows):
        first = 0
        for t in range(time):
            first = t if starts[row, t] else first
            for k in range(min(steps, t - first + 1)):
                expected[row, t, k] = values[row, t - k]
    return expected.flatten(-2)


@pytest.fixture
def counting_env():
    return Counting


@pytest.fixture
def agents_env():
    return Agents


@pytest.fixture(name="histories")
def histories_by_definition():
    return histories
