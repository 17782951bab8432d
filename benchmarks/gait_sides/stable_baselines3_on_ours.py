"""Stable-Baselines3's PPO on our robots, which are one of its vector environments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from benchmarks.gait_sides import Task
from benchmarks.gait_sides.our_robots import OurRobots
from benchmarks.gait_sides.record import Recorder
from benchmarks.gait_sides.stable_baselines3_ppo import learn_with_ppo

#: With PPO's defaults: as many as the report has.
ROBOTS = 64


def learn(task: Task, recorder: Recorder) -> None:
    ours = task.hyperparameters
    robots = ROBOTS if ours is None else ours.num_envs
    env = OurVecEnv(OurRobots(task.robot, robots, task.seed))
    learn_with_ppo(env, ours, task.seed, recorder)
    env.close()


class OurVecEnv(VecEnv):
    """Our robots, all stepped together.

    Args:
        robots: their environment.
    """

    def __init__(self, robots: OurRobots) -> None:
        self._robots = robots
        size = robots.observations.shape[-1]
        super().__init__(
            robots.num_envs,
            gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32),
            gymnasium.spaces.Box(-1.0, 1.0, (robots.num_actions,), np.float32),
        )

    def reset(self) -> np.ndarray:
        return self._robots.reset().numpy()

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = torch.from_numpy(actions)

    def step_wait(self) -> VecEnvStepReturn:
        rewards, done, last = self._robots.step(self._actions)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for robot in done.nonzero().flatten().tolist():
            infos[robot]["terminal_observation"] = last[robot].numpy()
        return self._robots.observations.numpy(), rewards.numpy(), done.numpy(), infos

    def close(self) -> None:
        self._robots.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        known = {"render_mode": None}
        return [known[attr_name] for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise AttributeError(attr_name)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        raise AttributeError(method_name)

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> Sequence[bool]:
        return [False for _ in self._get_indices(indices)]
