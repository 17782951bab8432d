"""Stable-Baselines3's PPO with its own ``SubprocVecEnv``, a process for each robot."""

from __future__ import annotations

import functools

import mujoco
from stable_baselines3.common.vec_env import SubprocVecEnv

from benchmarks.gait_sides import HISTORY, Task
from benchmarks.gait_sides.record import Recorder
from benchmarks.gait_sides.stable_baselines3_ppo import learn_with_ppo
from benchmarks.gymnasium_env import WalkAwayEnv
from benchmarks.rivals import START_METHOD

#: With PPO's defaults: those of the example in its documentation.
ROBOTS = 4


def learn(task: Task, recorder: Recorder) -> None:
    ours = task.hyperparameters and task.hyperparameters.in_processes()
    model = mujoco.MjModel.from_binary_path(task.model)
    make = functools.partial(WalkAwayEnv, model, HISTORY)
    robots = ROBOTS if ours is None else ours.num_envs
    env = SubprocVecEnv([make] * robots, start_method=START_METHOD)
    learn_with_ppo(env, ours, task.seed, recorder)
    env.close()
