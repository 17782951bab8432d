"""MuJoCo Warp: thousands of robots on a GPU."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Iterator, Mapping
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import torch
import warp as wp

from locomotion.options import ConfigError
from locomotion.physics.base import Physics
from locomotion.physics.bounds import Limits

#: Most contacts of a box on a plane, its face's corners.
_CORNERS = 4
#: Warp's notes that contacts or constraints had no room and were left out.
_NO_ROOM = int(mjw.OverflowType.BROADPHASE | mjw.OverflowType.NARROWPHASE | mjw.OverflowType.NEFC)


class WarpPhysics(Physics):
    """Steps all copies with MuJoCo Warp, on a GPU or on Warp's own CPU device.

    Warp computes in float32, where a place kilometres away has no millimetres, nor an hour its
    milliseconds. So states are kept in float64, and every step begins with each copy at Warp's origin and
    at time 0, and adds what it moved to its place: a copy that is far away moves as one that is not. All
    of it stays on the device; the physics steps of a control step are one graph, captured when a number
    of steps is first asked for.

    Contacts are found as MuJoCo finds them. The solver stops at a tolerance of 1e-6 or the model's,
    whichever is larger, which is Warp's doing: float32 has no more digits. A copy that is not to be
    stepped is stepped with the others, and put back. Derived places such as ``xpos`` are Warp's: along the
    ground they count from where the core was when the step began.

    Args:
        model: the compiled model.
        num_envs: number of copies.
        device: ``cpu``, ``cuda:0`` and so on.
        contacts: how many contacts at once each copy has room for. ``None`` makes room for all
            that can be with the ground, and two for each geom that can touch another module.
        limits: what is believed of a robot's motion.
    """

    #: The size of a graph, and the time to capture it, grow with its steps.
    MAX_STEPS = 50

    def __init__(
        self,
        model: mujoco.MjModel,
        num_envs: int,
        device: str = "cpu",
        contacts: int | None = None,
        limits: Limits | None = None,
    ) -> None:
        super().__init__(model, num_envs, torch.device(device), limits)
        self.contacts = contacts or suggested_contacts(model)
        self._warp_device = _warp_device(device)
        self._motion = self.previous.clone()
        self._graphs: dict[int, wp.Graph] = {}
        self._fields: dict[str, torch.Tensor] = {}
        with wp.ScopedDevice(self._warp_device):
            self._model = mjw.put_model(_with_mujocos_contacts(model))
            # A part of it is raised below, the rest does not matter.
            self._model.opt.warn_overflow = 0
            # Robots share the room for contacts, but not that for constraints. One that has gone
            # wrong can be in the ground with all corners, and must not take the room of others.
            rows = _rows(model, self.contacts)
            self._data = mjw.make_data(
                model,
                num_envs,
                nconmax=2 * self.contacts,
                njmax=rows,
                njmax_nnz=rows * model.nv,  # Warp's guess for long bodies could be too small
            )
            # Warp's arrays, seen by torch.
            self._time32 = self._seen(self._data.time)
            self._qpos32 = self._seen(self._data.qpos)
            self._qvel32 = self._seen(self._data.qvel)
            self._control = self._seen(self._data.ctrl)
            self._overflow = self._seen(self._data.overflow)
            self._carrier = self._seen(self._data.mocap_pos) if model.nmocap else None
            self._under_way = self._seen(self._data.history) if model.nhistory else None
            self._moments = torch.as_tensor(_history_times(model), device=self.device)
            mjw.step(self._model, self._data)  # loads all kernels, before any capture
        # From here on all is done on torch's stream, and the above was not.
        wp.synchronize_device(self._warp_device)
        self._overflow.zero_()
        self.reset()

    def _seen(self, array: wp.array) -> torch.Tensor:
        """A view for torch, whatever torch's default device is."""
        with self.device:
            return wp.to_torch(array)

    def _arguments(self) -> tuple[Any, ...]:
        return self.model, self.num_envs, str(self.device), self.contacts, self.limits

    @property
    def motion(self) -> torch.Tensor:
        return self._motion

    @property
    def control(self) -> torch.Tensor:
        return self._control

    def field(self, name: str) -> torch.Tensor:
        if name == "time":
            return self._motion[:, 0]
        if name in ("qpos", "qvel"):
            return getattr(self, name)
        if name not in self._fields:
            self._require_open()
            self._fields[name] = self._seen(getattr(self._data, name))
            self.forward()
        return self._fields[name]

    @property
    def _history(self) -> torch.Tensor | None:
        return self._under_way

    def _expand(self, name: str) -> torch.Tensor:
        shared = getattr(self._model, name)
        repeated = np.repeat(shared.numpy()[:1], self.num_envs, axis=0)
        own = wp.array(repeated, dtype=shared.dtype, device=self._warp_device)
        setattr(self._model, name, own)
        self._graphs.clear()  # they read the shared one
        return self._seen(own)

    def set_const(self) -> None:
        self._require_open()
        # Constants that depend on others have a value for each copy too.
        for name in ("body_subtreemass", "body_invweight0", "dof_invweight0", "actuator_acc0"):
            self.expand(name)
        if "geom_size" in self._parameters:
            for name in ("geom_aabb", "geom_rbound"):
                self.expand(name)
        with wp.ScopedDevice(self._warp_device):
            mjw.set_const(self._model, self._data)

    def forward(self, where: torch.Tensor | None = None) -> None:
        self._require_open()
        if self._fields:
            with self._keeping(where):
                self._follow()
                self._load()
                with wp.ScopedDevice(self._warp_device):
                    mjw.forward(self._model, self._data)
            self._overflow.zero_()

    @contextlib.contextmanager
    def _keeping(self, where: torch.Tensor | None) -> Iterator[None]:
        """Leaves copies other than those as they are, though Warp steps all of them."""
        kept = [] if where is None else [self._motion, *self._fields.values()]
        if where is not None and self._under_way is not None:
            kept.append(self._under_way)
        before = [view.clone() for view in kept]
        yield
        for view, old in zip(kept, before):
            view.copy_(torch.where(where.reshape(-1, *[1] * (view.dim() - 1)), view, old))

    def _reset(self, where: torch.Tensor | None) -> None:
        rows = slice(None) if where is None else where
        self._motion[rows] = 0.0
        initial = self.parameter("qpos0").to(self._motion).expand(self.num_envs, -1)
        self._motion[rows, 1 : 1 + self.model.nq] = initial[rows]
        self._control[rows] = 0.0
        if self._under_way is not None:
            chosen = None if where is None else wp.from_torch(where.contiguous())
            with wp.ScopedDevice(self._warp_device):
                mjw.reset_history(self._model, self._data, chosen)

    def _advance(self, num_steps: int, where: torch.Tensor | None) -> None:
        with self._keeping(where):
            self._load()
            self._launch(num_steps)
            if self._under_way is not None:
                self._under_way[:, self._moments] -= self._time32[:, None]
            self._motion[:, 0] += num_steps * self.model.opt.timestep
            self._motion[:, 1:3] += self._qpos32[:, :2]
            self._motion[:, 3:] = torch.cat([self._qpos32[:, 2:], self._qvel32], 1)

    def _load(self) -> None:
        """Gives Warp the states, each at the origin and at time 0."""
        nq = self.model.nq
        self._time32.zero_()
        self._qpos32.copy_(self._motion[:, 1 : 1 + nq])
        self._qpos32[:, :2] = 0.0
        self._qvel32.copy_(self._motion[:, 1 + nq :])
        if self._carrier is not None and self._period is not None:
            self._carrier[:, 0, :2] = self._ground - self._motion[:, 1:3]

    def _any(self, wrong: torch.Tensor) -> bool:
        no_room = ((self._overflow & _NO_ROOM) != 0) & ~wrong
        crowded, any_wrong = torch.stack([no_room.any(), wrong.any()]).tolist()
        self._overflow.zero_()
        if crowded:
            raise ConfigError(
                f"robots have more contacts at once than the {self.contacts} each that there is"
                f" room for; physics.contacts={2 * self.contacts} gives them more"
            )
        return any_wrong

    def _launch(self, num_steps: int) -> None:
        if num_steps not in self._graphs:
            self._graphs[num_steps] = self._capture(num_steps)
        # Torch's queue so far comes before it, and what torch will queue after.
        stream = wp.stream_from_torch(self.device) if self._warp_device.is_cuda else None
        wp.capture_launch(self._graphs[num_steps], stream)

    def _capture(self, num_steps: int) -> wp.Graph:
        with wp.ScopedDevice(self._warp_device), wp.ScopedCapture() as capture:
            for _ in range(num_steps):
                mjw.step(self._model, self._data)
        return capture.graph

    def _cleanse(self, wrong: torch.Tensor) -> None:
        # Warp multiplies constraints that are no longer there by 0, which leaves a nan what it is.
        for left_over in (self._data.efc.J, self._data.efc.D):
            self._seen(left_over)[wrong] = 0.0

    def state_dict(self) -> dict[str, Any]:
        self._require_open()
        under_way = {} if self._under_way is None else {"history": self._under_way.clone()}
        return {
            "motion": self._motion.clone(),
            "control": self._control.clone(),
            **under_way,
            "parameters": {name: value.clone() for name, value in self._parameters.items()},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self.closed = False
        self._load_parameters(state["parameters"])
        self._motion.copy_(state["motion"])
        self._control.copy_(state["control"])
        if self._under_way is not None:
            self._under_way.copy_(state["history"])
        self.forward()

    def close(self) -> None:
        self._graphs.clear()
        self.closed = True


def _warp_device(device: str) -> wp.Device:
    wp.config.log_level = wp.LOG_WARNING  # no line for each kernel that is loaded
    try:
        return wp.get_device(device)
    except (RuntimeError, ValueError) as error:
        raise ConfigError(f"physics.device={device}: Warp has no such device: {error}") from error


def suggested_contacts(model: mujoco.MjModel) -> int:
    """Room for contacts that a robot needs: all with the ground, and some with itself."""
    touching = (model.geom_contype & model.geom_conaffinity) != 0
    return max(1, _CORNERS * model.npair + 2 * int(touching.sum()))


def _rows(model: mujoco.MjModel, contacts: int) -> int:
    """The number of constraints of some contacts and of all joints at their limits."""
    dimension = max(model.pair_dim.max(initial=1), model.geom_condim.max())
    return int(max(1, 2 * (dimension - 1)) * contacts + model.jnt_limited.sum())


def _with_mujocos_contacts(model: mujoco.MjModel) -> mujoco.MjModel:
    """The model with boxes that touch as in MuJoCo, which has a function for two boxes.

    To Warp the flag means that it uses its copy of that function; to MuJoCo something else.
    """
    model = copy.copy(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
    return model


def _history_times(model: mujoco.MjModel) -> np.ndarray:
    """Mask of the numbers of a history that are times: of each buffer, those after its user value and cursor."""
    return np.concatenate(
        [np.zeros(0, np.int64)]
        + [
            address + 2 + np.arange(samples)
            for address, samples in (
                *zip(model.actuator_historyadr, model.actuator_history[:, 0]),
                *zip(model.sensor_historyadr, model.sensor_history[:, 0]),
            )
            if samples
        ]
    ).astype(np.int64)
