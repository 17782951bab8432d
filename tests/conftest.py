import importlib.util
import os

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import Binary, Composite, Unbounded
from torchrl.envs import EnvBase
from warm_python import WarmPython

# As training does: on two cores a second thread for networks this small costs time.
torch.set_num_threads(1)

_no_warp = pytest.mark.skipif(
    importlib.util.find_spec("mujoco_warp") is None,
    reason="needs packages: pip install -e '.[warp]'",
)
_slow = pytest.mark.slow  # Warp compiles kernels when it is first used on a machine
_no_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU here")


def pytest_collection_modifyitems(items):
    for item in items:
        if "drawing" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.graphics)


@pytest.fixture(
    scope="session",
    params=[
        pytest.param({"backend": "threaded", "threads": 2}, id="threaded"),
        pytest.param({"backend": "warp", "device": "cpu"}, id="warp", marks=[_no_warp, _slow]),
        pytest.param(
            {"backend": "warp", "device": "cuda:0"},
            id="gpu",
            marks=[_no_warp, _no_gpu, _slow, pytest.mark.gpu],
        ),
    ],
)
def stepping(request):
    """The keys of ``physics`` for all that can step robots."""
    return request.param


@pytest.fixture(scope="session")
def command():
    """Runs a command of the project in a process of its own.

    ``path`` is a folder with packages, ``variables`` are of the environment; ``None`` unsets one.
    """
    python = WarmPython()

    def run(name, *arguments, cwd, path=None, **variables):
        path = {} if path is None else {"PYTHONPATH": str(path)}
        environment = {**os.environ, **path, **variables}
        environment = {name: value for name, value in environment.items() if value is not None}
        return python.run(f"locomotion.{name}", arguments, cwd, environment)

    yield run
    python.close()


@pytest.fixture(params=["float64", "float16", "meta"])
def others_defaults(request):
    """Sets torch's default dtype, or its default device, in a block.

    The device ``meta`` stands for any but the CPU.
    """

    class Block:
        def __enter__(self):
            if request.param == "meta":
                torch.set_default_device("meta")
            else:
                torch.set_default_dtype(getattr(torch, request.param))

        def __exit__(self, *_):
            torch.set_default_device(None)
            torch.set_default_dtype(torch.float32)

    yield Block()
    Block().__exit__()


class Target(EnvBase):
    """Pays for hitting a target that the observation names; the best action is known.

    Args:
        num_envs: how many.
        length: steps of an episode, in which the target stays where it is; ``None``: it is somewhere
            else in every step, and there are no episodes.
        hides: whether the target is seen in the first step of an episode alone, and is 0 in others.
    """

    def __init__(self, num_envs, length=None, hides=False):
        super().__init__(batch_size=[num_envs])
        self.observation_spec = Composite(target=Unbounded((num_envs, 2)), shape=(num_envs,))
        self.action_spec = Unbounded((num_envs, 2))
        self.reward_spec = Unbounded((num_envs, 1))
        flags = {
            name: Binary(1, (num_envs, 1), dtype=torch.bool)
            for name in ("done", "terminated", "truncated")
        }
        self.done_spec = Composite(flags, shape=(num_envs,))
        self.length, self.hides = length, hides
        self.target = torch.zeros(num_envs, 2)
        self.ages = torch.zeros(num_envs, 1)

    def get_extra_state(self):
        return {"target": self.target, "ages": self.ages}

    def set_extra_state(self, state):
        self.target, self.ages = state["target"], state["ages"]

    def _result(self, moved, **reward):
        self.target = torch.where(moved, torch.rand(self.target.shape) - 0.5, self.target)
        self.ages = torch.where(moved, 0.0, self.ages)
        seen = torch.where((self.ages == 0) | (not self.hides), self.target, 0.0)
        truncated = torch.zeros_like(moved) if self.length is None else self.ages >= self.length
        flags = {"done": truncated, "truncated": truncated.clone()}
        flags["terminated"] = torch.zeros_like(truncated)
        return TensorDict({"target": seen, **flags, **reward}, self.batch_size)

    def _reset(self, tensordict=None):
        where = None if tensordict is None else tensordict.get("_reset", None)
        return self._result(torch.ones_like(self.ages).bool() if where is None else where)

    def _step(self, tensordict):
        reward = -(tensordict["action"] - self.target).square().sum(-1, keepdim=True)
        self.ages = self.ages + 1
        return self._result(torch.full(self.ages.shape, self.length is None), reward=reward)

    def _set_seed(self, seed):
        torch.manual_seed(seed)


@pytest.fixture(scope="session")
def target_env():
    """A task of which everything is known."""
    return Target
