"""Other ways to batch MuJoCo that a user would pick: one process a robot, in three libraries.

All step the very model that training steps, at the same control frequency, with the same reward and
almost the same observation: the hinges' positions and the core's orientation, without a history.
They are spared the wrappers that come with them by default (time limits, checks, monitors), are
driven without a policy by precomputed actions of the distribution that an untrained policy draws
from, and store nothing.
"""

from __future__ import annotations

import functools

import mujoco
import numpy as np

#: How processes are started. Only Gymnasium does so by itself: the others' fresh interpreters would
#: import torch once a robot, which takes minutes and several times the memory.
START_METHOD = "fork"


class _PlainSide:
    """A side whose environment takes arrays of actions; a subclass makes both."""

    def step(self) -> int:
        for action in self._actions:
            self._env.step(action)
        return len(self._actions) * self._env.num_envs

    def close(self) -> None:
        self._env.close()


class GymnasiumSide(_PlainSide):
    """``gymnasium.vector.AsyncVectorEnv``, with shared memory as it comes."""

    def __init__(self, model: mujoco.MjModel, num_envs: int, steps: int) -> None:
        import gymnasium

        from benchmarks.gymnasium_env import WalkAwayEnv

        make = functools.partial(WalkAwayEnv, model)
        self._env = gymnasium.vector.AsyncVectorEnv([make] * num_envs, context=START_METHOD)
        self._actions = random_actions(steps, num_envs, model.nu)
        self._env.reset(seed=0)


class StableBaselines3Side(_PlainSide):
    """``stable_baselines3``'s ``SubprocVecEnv``, which talks to its processes through pipes."""

    def __init__(self, model: mujoco.MjModel, num_envs: int, steps: int) -> None:
        from stable_baselines3.common.vec_env import SubprocVecEnv

        from benchmarks.gymnasium_env import WalkAwayEnv

        make = functools.partial(WalkAwayEnv, model)
        self._env = SubprocVecEnv([make] * num_envs, start_method=START_METHOD)
        self._actions = random_actions(steps, num_envs, model.nu)
        self._env.seed(0)
        self._env.reset()


class TorchRLSide:
    """TorchRL's ``ParallelEnv`` over dm-control, with shared memory as it comes."""

    def __init__(self, model: mujoco.MjModel, num_envs: int, steps: int) -> None:
        import torch
        from tensordict import TensorDict
        from torchrl.envs import ParallelEnv

        from benchmarks.dm_control_env import make_env

        make = functools.partial(make_env, model)
        self._env = ParallelEnv(num_envs, make, mp_start_method=START_METHOD)
        actions = torch.from_numpy(random_actions(steps, num_envs, model.nu).astype(np.float64))
        self._actions = [TensorDict({"action": action}, [num_envs]) for action in actions]
        self._env.reset()

    def step(self) -> int:
        for action in self._actions:
            self._env.step(action.copy())
        return len(self._actions) * self._env.num_workers

    def close(self) -> None:
        self._env.close()


#: By name: the side, and how many times as many frames a second ours should have.
RIVALS = {
    "TorchRL ParallelEnv": (TorchRLSide, 3.5),
    "Stable-Baselines3 SubprocVecEnv": (StableBaselines3Side, 2.0),
    "Gymnasium AsyncVectorEnv": (GymnasiumSide, 2.0),
}


def random_actions(steps: int, num_envs: int, size: int) -> np.ndarray:
    """Actions as an untrained policy draws them: from N(0, 1), clipped to [-1, 1] (rad)."""
    actions = np.random.default_rng(0).standard_normal((steps, num_envs, size), np.float32)
    return actions.clip(-1, 1)
