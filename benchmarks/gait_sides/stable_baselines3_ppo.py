"""Stable-Baselines3's PPO, on whatever vector environment."""

from __future__ import annotations

from typing import Any

from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from benchmarks.gait_sides import Hyperparameters
from benchmarks.gait_sides.record import Recorder

#: Control steps in an iteration with PPO's defaults: 2,048 of each of the four environments of the
#: example in its documentation.
FRAMES = 4 * 2048


def learn_with_ppo(
    env: VecEnv, hyperparameters: Hyperparameters | None, seed: int, recorder: Recorder
) -> None:
    """Learns until the hyperparameters' last iteration, or without an end.

    With its defaults PPO is told nothing but the number of steps; see :data:`FRAMES`.
    """
    if hyperparameters is None:
        model = PPO("MlpPolicy", env, n_steps=FRAMES // env.num_envs, seed=seed, device="cpu")
        total = 10**9
    else:
        model = PPO("MlpPolicy", env, seed=seed, device="cpu", **_as_arguments(hyperparameters))
        total = env.num_envs * hyperparameters.steps * hyperparameters.iterations
    model.learn(total, callback=_Recording(recorder))


def _as_arguments(ours: Hyperparameters) -> dict[str, Any]:
    return {
        "n_steps": ours.steps,
        "batch_size": ours.minibatch_size,
        "n_epochs": ours.epochs,
        "learning_rate": lambda remaining: ours.learning_rate * remaining,
        "gamma": ours.gamma,
        "gae_lambda": ours.gae_lambda,
        "clip_range": ours.clip_epsilon,
        "ent_coef": ours.entropy_coeff,
        "vf_coef": 1.0,
        "max_grad_norm": float("inf"),
        "policy_kwargs": {
            "net_arch": list(ours.hidden),
            "activation_fn": nn.Tanh,
        },
    }


class _Recording(BaseCallback):
    """Records iterations, each of which ends where the next one begins to collect."""

    def __init__(self, recorder: Recorder) -> None:
        super().__init__()
        self._recorder = recorder
        self._began = False

    def _on_rollout_start(self) -> None:
        if self._began:
            self._recorder.end_iteration()
        self._began = True

    def _on_step(self) -> bool:
        self._recorder.add(self.locals["rewards"])
        return True

    def _on_training_end(self) -> None:
        self._recorder.end_iteration()
