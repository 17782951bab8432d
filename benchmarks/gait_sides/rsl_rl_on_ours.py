"""rsl_rl's PPO on our robots."""

from __future__ import annotations

from typing import Any

import torch
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

from benchmarks.gait_sides import Hyperparameters, Task
from benchmarks.gait_sides.our_robots import OurRobots
from benchmarks.gait_sides.record import Recorder

#: With rsl_rl's documented settings, which leave the number open: as many as the report has.
ROBOTS = 64
#: The documentation's example, with the defaults of all that it leaves out.
DOCUMENTED = {
    "num_steps_per_env": 24,
    "save_interval": 100,
    "algorithm": {"class_name": "PPO"},
    "actor": {
        "class_name": "MLPModel",
        "distribution_cfg": {"class_name": "GaussianDistribution"},
    },
    "critic": {"class_name": "MLPModel"},
}


def learn(task: Task, recorder: Recorder) -> None:
    ours = task.hyperparameters
    torch.manual_seed(task.seed)
    robots = OurRobots(task.robot, ROBOTS if ours is None else ours.num_envs, task.seed)
    settings = DOCUMENTED if ours is None else _as_settings(ours)
    groups = {"obs_groups": {"actor": ["policy"], "critic": ["policy"]}}
    runner = OnPolicyRunner(_OurVecEnv(robots, recorder), {**settings, **groups})
    iteration = 0
    while ours is None or iteration < ours.iterations:
        if ours is not None:  # rsl_rl has no linear schedule
            rate = ours.learning_rate * (1 - iteration / ours.iterations)
            for group in runner.alg.optimizer.param_groups:
                group["lr"] = rate
        runner.learn(1)
        recorder.end_iteration()
        iteration += 1
    robots.close()


def _as_settings(ours: Hyperparameters) -> dict[str, Any]:
    network = {"class_name": "MLPModel", "hidden_dims": list(ours.hidden), "activation": "tanh"}
    return {
        **DOCUMENTED,
        "num_steps_per_env": ours.steps,
        "algorithm": {
            "class_name": "PPO",
            "learning_rate": ours.learning_rate,
            "schedule": "fixed",
            "num_learning_epochs": ours.epochs,
            "num_mini_batches": ours.num_envs * ours.steps // ours.minibatch_size,
            "gamma": ours.gamma,
            "lam": ours.gae_lambda,
            "clip_param": ours.clip_epsilon,
            "entropy_coef": ours.entropy_coeff,
            "use_clipped_value_loss": False,
            "max_grad_norm": float("inf"),
            "normalize_advantage_per_mini_batch": True,
        },
        "actor": {
            **network,
            "distribution_cfg": {"class_name": "GaussianDistribution", "std_type": "log"},
        },
        "critic": network,
    }


class _OurVecEnv(VecEnv):
    """Our robots as rsl_rl wants them; what they earn is recorded."""

    def __init__(self, robots: OurRobots, recorder: Recorder) -> None:
        self._robots = robots
        self._recorder = recorder
        self.num_envs = robots.num_envs
        self.num_actions = robots.num_actions
        self.max_episode_length = 10**9
        self.episode_length_buf = torch.zeros(robots.num_envs, dtype=torch.int64)
        self.device = "cpu"
        self.cfg = {}

    def get_observations(self) -> TensorDict:
        return TensorDict({"policy": self._robots.observations}, [self.num_envs])

    def step(
        self, actions: torch.Tensor
    ) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        rewards, done, _ = self._robots.step(actions)
        self._recorder.add(rewards)
        return self.get_observations(), rewards, done, {}
