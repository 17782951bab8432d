"""MuJoCo and nothing else, as fast as it can be called: the limit of what training collects."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np
import torch

if TYPE_CHECKING:
    from locomotion.physics.warp import WarpPhysics


class BareRollout:
    """``mujoco.rollout``, one call a control step.

    Args:
        model: what is stepped.
        num_envs: copies of it.
        substeps: physics steps in a control step.
        threads: threads that share the copies; 1 steps them on the calling thread.
    """

    def __init__(self, model: mujoco.MjModel, num_envs: int, substeps: int, threads: int) -> None:
        self._models = [model] * num_envs
        self._data = [mujoco.MjData(model) for _ in range(threads)]
        self._rollout = mujoco.rollout.Rollout(nthread=threads if threads > 1 else 0)
        size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self._substeps = substeps
        self._states = np.empty((num_envs, substeps, size))

    def replay(self, start: np.ndarray, controls: np.ndarray) -> tuple[np.ndarray, float]:
        """Steps all copies through recorded controls.

        Args:
            start: times, positions and velocities, shape ``(num_envs, 1 + nq + nv)``.
            controls: shape ``(steps, num_envs, nu)``.

        Returns:
            Times, positions and velocities at the end, and how long it took (s).
        """
        held = np.repeat(controls[:, :, None], self._substeps, axis=2)
        state = start.copy()
        last = self._states[:, -1]
        started = time.perf_counter()
        for control in held:
            self._rollout.rollout(
                self._models,
                self._data,
                state,
                control,
                skip_checks=True,
                nstep=self._substeps,
                state=self._states,
            )
            np.copyto(state, last)
        return state, time.perf_counter() - started

    def close(self) -> None:
        self._rollout.close()


class BareBatch:
    """``mujoco.batch.Batch``, one call a control step; arguments as for :class:`BareRollout`."""

    def __init__(self, model: mujoco.MjModel, num_envs: int, substeps: int, threads: int) -> None:
        self._batch = mujoco.batch.Batch(model, num_envs, threads)
        self._control = self._batch.bind("ctrl")
        self._substeps = substeps

    def replay(self, start: np.ndarray, controls: np.ndarray) -> tuple[np.ndarray, float]:
        """Steps all copies through recorded controls, as :meth:`BareRollout.replay` does."""
        self._batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        motion = self._batch.state[:, : start.shape[1]]
        motion[:] = start
        started = time.perf_counter()
        for control in controls:
            self._control[:] = control
            self._batch.step(nstep=self._substeps)
        return motion.copy(), time.perf_counter() - started


class BareWarp:
    """MuJoCo Warp: a captured graph a control step, with the model and the room of training's physics.

    Args:
        physics: whose Warp model, data and graphs are used; its own state stays as it is.
        substeps: physics steps in a control step.
    """

    def __init__(self, physics: WarpPhysics, substeps: int) -> None:
        self._physics = physics
        self._substeps = substeps

    def load(self, qpos: torch.Tensor, qvel: torch.Tensor) -> None:
        """Puts all copies into states, shapes ``(num_envs, nq)`` and ``(num_envs, nv)``."""
        self._physics._qpos32.copy_(qpos)
        self._physics._qvel32.copy_(qvel)

    def replay(self, actions: torch.Tensor) -> None:
        """Steps all copies under actions, shape ``(num_envs, steps, nu)``."""
        for control in actions.unbind(1):
            self._physics.control.copy_(control)
            self._physics._launch(self._substeps)
