"""MuJoCo's own batched simulation, on the cores of the CPU."""

from __future__ import annotations

import copy
import os
import warnings
from collections.abc import Mapping
from typing import Any

import mujoco
import torch
from mujoco.batch import Batch, SimulationError

from locomotion.physics.base import Physics

_NO_STAGE = int(mujoco.mjtStage.mjSTAGE_NONE)


class BatchPhysics(Physics):
    """Steps all copies with ``mujoco.batch``: one call a control step, shared out over threads.

    Results do not depend on the number of threads.

    Args:
        model: the compiled model.
        num_envs: number of copies.
        threads: threads that step them; ``None`` takes one for each core that the process may use.
    """

    MOST_STEPS = 1000

    def __init__(self, model: mujoco.MjModel, num_envs: int, threads: int | None = None) -> None:
        super().__init__(model, num_envs, torch.device("cpu"))
        # A robot that went wrong is seen by its state, which MuJoCo would otherwise make a sound one of.
        own = copy.copy(model)
        own.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self._batch = Batch(own, num_envs, threads or _usable_cores())
        self._state = torch.from_numpy(self._batch.state)
        self._motion = self._state[:, : 1 + model.nq + model.nv]
        self._control = self._view(self._batch.bind("ctrl"))
        self._fields = {"qpos": self.qpos, "qvel": self.qvel}
        self._under_way = self._view(self._batch.bind("history")) if model.nhistory else None
        self._derives = False
        self._own_constants = False
        self.reset()

    @staticmethod
    def _view(array: Any) -> torch.Tensor:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # derived fields are read-only, and only read
            return torch.from_numpy(array)

    @property
    def motion(self) -> torch.Tensor:
        return self._motion

    @property
    def control(self) -> torch.Tensor:
        return self._control

    def field(self, name: str) -> torch.Tensor:
        if name not in self._fields:
            array = self._batch.bind(name)
            self._derives |= not array.flags.writeable
            self._fields[name] = self._view(array)
            self.forward()
        return self._fields[name]

    @property
    def _history(self) -> torch.Tensor | None:
        return self._under_way

    def _expand(self, name: str) -> torch.Tensor:
        return self._view(self._batch.expand(name))

    def set_const(self) -> None:
        self._batch.set_const()
        self._own_constants = True

    def forward(self, where: torch.Tensor | None = None) -> None:
        if self._derives:
            self._batch.forward(None if where is None else where.numpy())

    def _reset(self, where: torch.Tensor | None) -> None:
        self._batch.reset(None if where is None else where.numpy(), stage=_NO_STAGE)

    def _advance(self, num_steps: int, where: torch.Tensor | None) -> None:
        try:
            self._batch.step(None if where is None else where.numpy(), num_steps)
        except SimulationError:
            pass  # these kept the state, and so the time, that they had

    def state_dict(self) -> dict[str, Any]:
        return {
            "state": self._state.clone(),
            "parameters": {name: value.clone() for name, value in self._parameters.items()},
            "own_constants": self._own_constants,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._load_parameters(state["parameters"])
        if self._own_constants or state["own_constants"]:
            self.set_const()
        self._state.copy_(state["state"])
        self.forward()

    def close(self) -> None:
        if self._batch is not None:
            self._motion, self._control = self._motion.clone(), self._control.clone()
            self._fields, self._parameters = {"qpos": self.qpos, "qvel": self.qvel}, {}
            self._state = self._under_way = None
            self._batch = None


def _usable_cores() -> int:
    if hasattr(os, "sched_getaffinity"):  # where there is one, it knows about pinned processes
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
