"""MuJoCo Warp: thousands of robots on a GPU."""

from __future__ import annotations

import copy

import mujoco
import mujoco_warp as mjw
import torch
import warp as wp

from locomotion.config import ConfigError
from locomotion.physics.base import CEILING, MOST_SPEED, MOST_STATE, Physics, require_plain

#: Steps of one graph, whose size and time to capture grow with them.
_MOST_STEPS = 50
#: Most contacts of a box on a plane, its face's corners.
_CORNERS = 4
#: What Warp notes when contacts or constraints had no room and were left out.
_NO_ROOM = int(mjw.OverflowType.BROADPHASE | mjw.OverflowType.NARROWPHASE | mjw.OverflowType.NEFC)


class WarpPhysics(Physics):
    """Steps all copies with MuJoCo Warp, on a GPU or on Warp's own CPU device.

    Warp computes in float32, where a place kilometres away has no millimetres. So states are kept in
    float64, and every step begins with each copy at Warp's origin and adds what it moved to its place:
    a copy that is far away moves as one that is not. All of it stays on the device; the physics
    steps of a control step are one graph, captured when a number of steps is first asked for.

    Contacts are found as MuJoCo finds them. The solver stops at a tolerance of 1e-6 or the model's,
    whichever is larger, which is Warp's doing: float32 has no more digits. A copy that is not to be
    stepped is stepped with the others, and put back.

    Args:
        model: compiled model; its state must be positions and velocities only.
        num_envs: number of copies.
        device: ``cpu``, ``cuda:0`` and so on.
        contacts: how many contacts at once each copy has room for. ``None`` makes room for all
            that can be with the ground, and two for each geom that can touch another module.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        num_envs: int,
        device: str = "cpu",
        contacts: int | None = None,
    ) -> None:
        require_plain(model)
        self.model = model
        self.num_envs = num_envs
        self.device = torch.device(device)
        self.contacts = contacts or suggested_contacts(model)
        self._warp_device = _warp_device(device)
        self._qpos0 = torch.tensor(model.qpos0, device=self.device)
        self._qpos = self._qpos0.repeat(num_envs, 1)
        self._qvel = self._qpos.new_zeros(num_envs, model.nv)
        self._graphs: dict[int, wp.Graph] = {}
        with wp.ScopedDevice(self._warp_device):
            self._model = mjw.put_model(_with_mujocos_contacts(model))
            self._model.opt.warn_overflow = 0  # what matters of it is raised below
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
            self._qpos32 = wp.to_torch(self._data.qpos)
            self._qvel32 = wp.to_torch(self._data.qvel)
            self._control = wp.to_torch(self._data.ctrl)
            self._overflow = wp.to_torch(self._data.overflow)
            mjw.step(self._model, self._data)  # loads all kernels, before any capture
        # From here on all is done on torch's stream, and the above was not.
        wp.synchronize_device(self._warp_device)

    @property
    def qpos(self) -> torch.Tensor:
        return self._qpos

    @property
    def qvel(self) -> torch.Tensor:
        return self._qvel

    def reset(self, where: torch.Tensor | None = None) -> None:
        rows = slice(None) if where is None else where
        self._qpos[rows] = self._qpos0
        self._qvel[rows] = 0.0

    def step(
        self, control: torch.Tensor, num_steps: int, where: torch.Tensor | None = None
    ) -> torch.Tensor | None:
        if num_steps == 0:
            return None
        self._control.copy_(control)
        self._overflow.zero_()
        qpos, qvel, wrong = self._qpos, self._qvel, None
        for done in range(0, num_steps, _MOST_STEPS):
            steps = min(_MOST_STEPS, num_steps - done)
            qpos, qvel, sound = self._advance(qpos, qvel, steps)
            wrong = ~sound if wrong is None else wrong | ~sound
        crowded = ((self._overflow & _NO_ROOM) != 0) & ~wrong
        # The only place where the host waits for the device.
        any_crowded, any_wrong = torch.stack([crowded.any(), wrong.any()]).tolist()
        if any_crowded:
            raise ConfigError(
                f"robots have more contacts at once than the {self.contacts} each that there is"
                f" room for; physics.contacts={2 * self.contacts} gives them more"
            )
        if any_wrong:
            self._put_back(qpos, qvel, wrong)
        if where is not None:
            wrong &= where
            qpos = torch.where(where[:, None], qpos, self._qpos)
            qvel = torch.where(where[:, None], qvel, self._qvel)
        self._qpos.copy_(qpos)
        self._qvel.copy_(qvel)
        return wrong if any_wrong and wrong.any() else None

    def _advance(
        self, qpos: torch.Tensor, qvel: torch.Tensor, num_steps: int
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Positions and velocities after so many steps, and which copies are sound."""
        self._qpos32.copy_(qpos)
        self._qpos32[:, :2] = 0.0
        self._qvel32.copy_(qvel)
        self._launch(num_steps)
        end_qpos, end_qvel = self._qpos32.double(), self._qvel32.double()
        reach = MOST_SPEED * num_steps * self.model.opt.timestep
        sound = (end_qpos[:, :2].abs() <= reach).all(1)
        end_qpos[:, :2] += qpos[:, :2]
        return end_qpos, end_qvel, sound & _is_sound(end_qpos, end_qvel)

    def _launch(self, num_steps: int) -> None:
        if num_steps not in self._graphs:
            self._graphs[num_steps] = self._capture(num_steps)
        # What torch has queued comes before, and what it will queue after.
        stream = wp.stream_from_torch(self.device) if self._warp_device.is_cuda else None
        wp.capture_launch(self._graphs[num_steps], stream)

    def _capture(self, num_steps: int) -> wp.Graph:
        with wp.ScopedDevice(self._warp_device), wp.ScopedCapture() as capture:
            for _ in range(num_steps):
                mjw.step(self._model, self._data)
        return capture.graph

    def _put_back(self, qpos: torch.Tensor, qvel: torch.Tensor, wrong: torch.Tensor) -> None:
        """Replaces what copies came to by where they were, or by the initial state."""
        lost = wrong & ~_is_sound(self._qpos, self._qvel)
        qpos[wrong] = self._qpos[wrong]
        qvel[wrong] = self._qvel[wrong]
        qpos[lost] = self._qpos0
        qvel[lost] = 0.0
        # Warp multiplies constraints that are no longer there by 0, which leaves a nan what it is.
        for left_over in (self._data.efc.J, self._data.efc.D):
            wp.to_torch(left_over)[wrong] = 0.0

    def close(self) -> None:
        self._graphs.clear()


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
    """Constraints of so many contacts and of all joints at their limits."""
    dimension = max(model.pair_dim.max(initial=1), model.geom_condim.max())
    return int(max(1, 2 * (dimension - 1)) * contacts + model.jnt_limited.sum())


def _with_mujocos_contacts(model: mujoco.MjModel) -> mujoco.MjModel:
    """The model with boxes that touch as in MuJoCo, which has a function for two boxes.

    To Warp the flag means that it uses its copy of that function; to MuJoCo something else.
    """
    model = copy.copy(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
    return model


def _is_sound(qpos: torch.Tensor, qvel: torch.Tensor) -> torch.Tensor:
    """Which states, a row each, may be stepped from; written so that what is no number fails."""
    return (
        qpos[:, :2].isfinite().all(1)
        & (qpos[:, 2].abs() <= CEILING)
        & (qpos[:, 2:].abs() <= MOST_STATE).all(1)
        & (qvel.abs() <= MOST_STATE).all(1)
    )
