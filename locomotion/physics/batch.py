"""MuJoCo's own batched simulation, on the cores of the CPU."""

from __future__ import annotations

import copy
import ctypes
import os
import warnings
import weakref
from collections.abc import Mapping
from typing import Any

import mujoco
import torch
from mujoco.batch import Batch, SimulationError

from locomotion.physics.base import Physics
from locomotion.physics.bounds import Limits

_NO_STAGE = int(mujoco.mjtStage.mjSTAGE_NONE)


class BatchPhysics(Physics):
    """Steps all copies with ``mujoco.batch``: one call a control step, shared out over threads.

    Results do not depend on the number of threads. A process that is forked has the memory of all
    copies, but not the threads that step them. The first call there makes both anew, with the states and
    parameters that copies have; tensors that were views before the fork are none of the new memory.

    Args:
        model: the compiled model.
        num_envs: number of copies.
        threads: threads that step them; ``None`` takes one for each core that the process may use.
        limits: what is believed of a robot's motion.
    """

    MAX_STEPS = 1000

    def __init__(
        self,
        model: mujoco.MjModel,
        num_envs: int,
        threads: int | None = None,
        limits: Limits | None = None,
    ) -> None:
        super().__init__(model, num_envs, torch.device("cpu"), limits)
        self._threads = threads
        self._make()
        self.reset()

    def _arguments(self) -> tuple[Any, ...]:
        return self.model, self.num_envs, self._threads, self.limits

    def _make(self) -> None:
        # A robot that went wrong is seen by its state, which MuJoCo would otherwise make a sound one of.
        own = copy.copy(self.model)
        own.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self._batch = Batch(own, self.num_envs, self._threads or _usable_cores())
        self._forks = _forks
        _memories.add(self._batch.state.base)
        self._state = torch.from_numpy(self._batch.state)
        self._motion = self._state[:, : 1 + own.nq + own.nv]
        self._control = self._view(self._batch.bind("ctrl"))
        self._fields = {"qpos": self.qpos, "qvel": self.qvel}
        self._carrier = self._view(self._batch.bind("mocap_pos")) if own.nmocap else None
        self._under_way = self._view(self._batch.bind("history")) if own.nhistory else None
        self._derives = False
        self._own_constants = False

    def _require_open(self) -> None:
        super()._require_open()
        self._require_threads()

    def _require_threads(self) -> None:
        if self._forks != _forks and not self.closed:
            self._forks = _forks
            self.__setstate__(self.__getstate__())

    @property
    def _simulations(self) -> Batch:
        self._require_open()
        return self._batch

    @staticmethod
    def _view(array: Any) -> torch.Tensor:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # derived fields are read-only, and only read
            return torch.from_numpy(array)

    @property
    def motion(self) -> torch.Tensor:
        self._require_threads()
        return self._motion

    @property
    def control(self) -> torch.Tensor:
        self._require_threads()
        return self._control

    def field(self, name: str) -> torch.Tensor:
        self._require_threads()
        if name not in self._fields:
            array = self._simulations.bind(name)
            self._derives |= not array.flags.writeable
            self._fields[name] = self._view(array)
            self.forward()
        return self._fields[name]

    @property
    def _history(self) -> torch.Tensor | None:
        return self._under_way

    def _expand(self, name: str) -> torch.Tensor:
        return self._view(self._simulations.expand(name))

    def _follow(self) -> None:
        super()._follow()
        if self._carrier is not None and self._period is not None:
            self._carrier[:, 0, :2] = self._ground

    def set_const(self) -> None:
        self._simulations.set_const()
        self._own_constants = True

    def forward(self, where: torch.Tensor | None = None) -> None:
        simulations = self._simulations
        if self._derives:
            self._follow()
            simulations.forward(None if where is None else where.numpy())

    def _reset(self, where: torch.Tensor | None) -> None:
        self._simulations.reset(None if where is None else where.numpy(), stage=_NO_STAGE)

    def _advance(self, num_steps: int, where: torch.Tensor | None) -> None:
        try:
            self._simulations.step(None if where is None else where.numpy(), num_steps)
        except SimulationError:
            pass  # these kept the state, and so the time, that they had

    def state_dict(self) -> dict[str, Any]:
        self._require_open()
        return {
            "state": self._state.clone(),
            "parameters": {name: value.clone() for name, value in self._parameters.items()},
            "own_constants": self._own_constants,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        if self.closed:
            asked_for = list(self._fields)
            self.closed = False
            self._make()
            for name in asked_for:
                self.field(name)
        self._require_threads()
        self._load_parameters(state["parameters"])
        if self._own_constants or state["own_constants"]:
            self.set_const()
        self._state.copy_(state["state"])
        self.forward()

    def close(self) -> None:
        if not self.closed:
            self._motion, self._control = self._motion.clone(), self._control.clone()
            self._fields = {name: value.clone() for name, value in self._fields.items()}
            self._parameters = {}
            self._state = self._under_way = None
            self._batch = None
            self.closed = True


#: MuJoCo's memory of all batches that there are, which ends their threads when it is freed.
_memories: weakref.WeakSet[Any] = weakref.WeakSet()
#: How often this process, from its first ancestor on, was forked.
_forks = 0


def _after_fork() -> None:
    """Keeps MuJoCo from waiting for ever for threads that the new process does not have."""
    global _forks
    _forks += 1
    for memory in list(_memories):
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(memory))  # it is never freed


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def _usable_cores() -> int:
    if hasattr(os, "sched_getaffinity"):  # where there is one, it knows about pinned processes
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
