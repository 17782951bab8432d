"""MuJoCo's own threaded rollout."""

from __future__ import annotations

import os

import mujoco
import mujoco.rollout
import numpy as np
import torch

from locomotion.physics.base import CEILING, MOST_SPEED, MOST_STATE, Physics, require_plain

#: Columns of a full physics state: time, then positions, which begin with the core's place and height,
#: then velocities.
_TIME, _PLACE, _HEIGHT = 0, slice(1, 3), 3
#: Every control step begins at this time (s). MuJoCo puts a state that it gives up back to time 0.
_START_TIME = 1.0
#: Steps of one rollout, which keeps the states of all of them: a second at a millisecond a step.
_MOST_STEPS = 1000


class ThreadedPhysics(Physics):
    """Steps all copies with ``mujoco.rollout``: one call a control step, shared out over threads.

    Results do not depend on the number of threads. A long control step is taken in parts, and the
    bounds of a sound simulation hold for each.

    Args:
        model: compiled model; its state must be positions and velocities only.
        num_envs: number of copies.
        threads: threads that step them; ``None`` takes one for each core that the process may use.
    """

    def __init__(self, model: mujoco.MjModel, num_envs: int, threads: int | None = None) -> None:
        require_plain(model)
        threads = threads or _usable_cores()
        self.model = model
        self.num_envs = num_envs
        self.device = torch.device("cpu")
        self._data = [mujoco.MjData(model) for _ in range(threads)]
        self._models = [model] * num_envs
        self._rollout = mujoco.rollout.Rollout(nthread=threads if threads > 1 else 0)
        self._state = np.zeros((num_envs, 1 + model.nq + model.nv))
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
        targets = control.numpy()[rows, None]
        end, wrong = before, None
        for done in range(0, num_steps, _MOST_STEPS):
            steps = min(_MOST_STEPS, num_steps - done)
            start = end if done == 0 else end.copy()
            start[:, _TIME] = _START_TIME
            end = self._rollout_to_end(start, targets, steps)
            wrong = self._diverged(start, end, steps, wrong)
        if wrong is None:
            self._state[rows] = end
            return None
        self._put_back(before, end, wrong)
        self._state[rows] = end
        diverged = torch.zeros(self.num_envs, dtype=torch.bool)
        diverged[rows] = torch.from_numpy(wrong)
        return diverged

    def _diverged(
        self, start: np.ndarray, end: np.ndarray, steps: int, before: np.ndarray | None
    ) -> np.ndarray | None:
        """Which copies went wrong, now or before; ``None`` if none did."""
        reach = MOST_SPEED * steps * self.model.opt.timestep
        way = end[:, _PLACE] - start[:, _PLACE]
        # Written so that what is no number fails.
        if (
            end[:, _TIME].min() > _START_TIME
            and np.abs(end[:, _HEIGHT:]).max() <= MOST_STATE
            and np.abs(end[:, _HEIGHT]).max() <= CEILING
            and np.abs(way).max() <= reach
        ):
            return before
        with np.errstate(invalid="ignore"):
            sound = (end[:, _TIME] > _START_TIME) & (np.abs(way) <= reach).all(1)
        wrong = ~(sound & _is_sound(end))
        wrong = wrong if before is None else wrong | before
        return wrong if wrong.any() else None

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
        lost = diverged & ~_is_sound(start)
        end[lost] = 0.0
        end[lost, 1 : 1 + self.model.nq] = self.model.qpos0

    def close(self) -> None:
        self._rollout.close()


def _is_sound(state: np.ndarray) -> np.ndarray:
    """Which states, a row each, may be stepped from."""
    with np.errstate(invalid="ignore"):
        sound = np.isfinite(state).all(1) & (np.abs(state[:, _HEIGHT]) <= CEILING)
        return sound & (np.abs(state[:, _HEIGHT:]) <= MOST_STATE).all(1)


def _usable_cores() -> int:
    if hasattr(os, "sched_getaffinity"):  # where there is one, it knows about pinned processes
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
