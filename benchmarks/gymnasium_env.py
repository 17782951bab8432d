"""The task as one would write it for Gymnasium and Stable-Baselines3."""

from __future__ import annotations

from typing import Any

import gymnasium
import mujoco
import numpy as np

from benchmarks.task import CONTROL_TIMESTEP, SETTLE_TIME


class WalkAwayEnv(gymnasium.Env):
    """One robot that walks away.

    Args:
        model: the compiled model.
        history: positions of the hinges that are observed, newest first, with zeros before the start;
            after them the core's quaternion.
    """

    def __init__(self, model: mujoco.MjModel, history: int = 1) -> None:
        self._model = model
        self._data = mujoco.MjData(model)
        self._substeps = round(CONTROL_TIMESTEP / model.opt.timestep)
        size = history * model.nu + 4
        self._seen = np.zeros(size, np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (model.nu,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        mujoco.mj_resetData(self._model, self._data)
        self._data.ctrl[:] = self.np_random.uniform(-1, 1, self._model.nu)
        mujoco.mj_step(self._model, self._data, nstep=round(SETTLE_TIME / self._model.opt.timestep))
        self._start = self._data.qpos[:2].copy()
        self._distance = 0.0
        self._seen[:] = 0.0
        return self._observation(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        self._data.ctrl[:] = np.clip(action, -1, 1)
        mujoco.mj_step(self._model, self._data, nstep=self._substeps)
        distance = float(np.linalg.norm(self._data.qpos[:2] - self._start))
        reward, self._distance = distance - self._distance, distance
        return self._observation(), reward, False, False, {}

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Generalised positions and velocities, copies."""
        return self._data.qpos.copy(), self._data.qvel.copy()

    def _observation(self) -> np.ndarray:
        hinges = self._model.nu
        self._seen[hinges:-4] = self._seen[: -4 - hinges].copy()
        self._seen[:hinges] = self._data.qpos[7:]
        self._seen[-4:] = self._data.qpos[3:7]
        return self._seen.copy()
