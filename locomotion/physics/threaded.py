"""MuJoCo's own threaded rollout."""

from __future__ import annotations

import math
import os

import mujoco
import mujoco.rollout
import numpy as np
import torch

from locomotion.physics.base import CEILING, Physics

#: Columns of a full physics state: time, then positions, of which the third is the core's height.
_TIME, _HEIGHT = 0, 3
#: Every control step begins at this time (s). MuJoCo puts a state that it gives up back to time 0.
_START_TIME = 1.0
#: Steps of one rollout, which keeps the states of all of them: a second at a millisecond a step.
_MOST_STEPS = 1000


class ThreadedPhysics(Physics):
    """Steps all copies with ``mujoco.rollout``: one call a control step, shared out over threads.

    Results do not depend on the number of threads.

    Args:
        model: compiled model; its state must be positions and velocities only.
        num_envs: number of copies.
        threads: threads that step them; ``None`` takes one for each core that the process may use.
    """

    def __init__(self, model: mujoco.MjModel, num_envs: int, threads: int | None = None) -> None:
        size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        if size != 1 + model.nq + model.nv or model.nsensordata:
            raise ValueError("the model has sensors, or state beyond time, positions, velocities")
        if model.jnt_type[0] != mujoco.mjtJoint.mjJNT_FREE:
            raise ValueError("the model's first joint is not free")
        threads = threads or _usable_cores()
        self.model = model
        self.num_envs = num_envs
        self._data = [mujoco.MjData(model) for _ in range(threads)]
        self._models = [model] * num_envs
        self._rollout = mujoco.rollout.Rollout(nthread=threads if threads > 1 else 0)
        self._state = np.zeros((num_envs, size))
        self._qpos = torch.from_numpy(self._state)[:, 1 : 1 + model.nq]
        self._qvel = torch.from_numpy(self._state)[:, 1 + model.nq :]
        self._allocate(1)
        self.reset()

    def _allocate(self, num_steps: int) -> None:
        """Makes the buffers that a rollout reads controls from and writes states to."""
        rows = (self.num_envs, num_steps)
        self._control = np.empty((*rows, self.model.nu))
        self._states = np.empty((*rows, self._state.shape[1]))
        self._no_sensors = np.empty((*rows, 0))

    @property
    def qpos(self) -> torch.Tensor:
        return self._qpos

    @property
    def qvel(self) -> torch.Tensor:
        return self._qvel

    def reset(self, where: torch.Tensor | None = None) -> None:
        rows = slice(None) if where is None else where.numpy()
        self._state[rows] = 0.0
        self._state[rows, 1 : 1 + self.model.nq] = self.model.qpos0

    def step(
        self, control: torch.Tensor, num_steps: int, where: torch.Tensor | None = None
    ) -> torch.Tensor | None:
        rows = slice(None) if where is None else where.numpy()
        before = self._state[rows]
        count = len(before)
        if count == 0 or num_steps == 0:
            return None
        before[:, _TIME] = _START_TIME
        if num_steps <= _MOST_STEPS:
            end = self._rollout_to_end(before, control.numpy()[rows, None], num_steps)
        else:
            end = before
            for done in range(0, num_steps, _MOST_STEPS):
                steps = min(_MOST_STEPS, num_steps - done)
                end = self._rollout_to_end(end.copy(), control.numpy()[rows, None], steps)
        diverged = None
        if not (
            math.isfinite(end.sum())
            and end[:, _TIME].min() > _START_TIME
            and end[:, _HEIGHT].max() <= CEILING
        ):
            wrong = ~self._is_sound(end) | (end[:, _TIME] <= _START_TIME)
            self._put_back(before, end, wrong)
            diverged = torch.zeros(self.num_envs, dtype=torch.bool)
            diverged[rows] = torch.from_numpy(wrong)
        self._state[rows] = end
        return diverged if diverged is not None and diverged.any() else None

    def _rollout_to_end(self, start: np.ndarray, control: np.ndarray, num_steps: int) -> np.ndarray:
        """The states after so many steps, a view of the buffer, shape ``(copies, state)``."""
        count = len(start)
        if self._states.shape[1] != num_steps:
            self._allocate(num_steps)
        self._control[:count] = control
        # All arrays are contiguous and have their shapes, which the skipped checks would establish.
        self._rollout.rollout(
            self._models[:count],
            self._data,
            start,
            self._control[:count],
            skip_checks=True,
            nstep=num_steps,
            state=self._states[:count],
            sensordata=self._no_sensors[:count],
        )
        return self._states[:count, -1]

    def _put_back(self, start: np.ndarray, end: np.ndarray, diverged: np.ndarray) -> None:
        """Replaces what diverged copies came to by where they were, or by the initial state."""
        end[diverged] = start[diverged]
        lost = diverged & ~self._is_sound(start)
        end[lost] = 0.0
        end[lost, 1 : 1 + self.model.nq] = self.model.qpos0

    @staticmethod
    def _is_sound(state: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            return np.isfinite(state).all(1) & (state[:, _HEIGHT] <= CEILING)

    def close(self) -> None:
        self._rollout.close()


def _usable_cores() -> int:
    if hasattr(os, "sched_getaffinity"):  # where there is one, it knows about pinned processes
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
