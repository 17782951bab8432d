"""The options of physics: how robots are stepped, and the properties of their modules."""

from __future__ import annotations

import dataclasses
import enum
import importlib.util
import re

from locomotion.options import Checked, ConfigError, key
from locomotion.robots.geometry import ARMATURE, DAMPING, FRICTION, STIFFNESS
from locomotion.tasks.options import TIMESTEP, Integrator

#: Motion that no robot reaches by itself: height of the core (m), and its speed along the ground (m/s).
HEIGHT_LIMIT, SPEED_LIMIT = 10.0, 20.0


class PhysicsBackend(enum.Enum):
    """Options of the physics."""

    threaded = "threaded"
    warp = "warp"


@dataclasses.dataclass
class PhysicsConfig(Checked):
    """The physics, and what steps it."""

    PREFIX = "physics."

    backend: PhysicsBackend = key(
        "threaded: MuJoCo on the CPU; warp: MuJoCo Warp, for GPUs", default=PhysicsBackend.threaded
    )
    device: str = key("cpu, or with physics=warp cuda:0, cuda:1, ...", default="cpu")
    threads: int | None = key(
        "threads that step robots; null: one for each core",
        default=None,
        least=1,
        most=4096,
        free=True,
    )
    contacts: int | None = key(
        "with physics=warp, contacts at once that a robot has room for; null: what its model suggests",
        default=None,
        least=1,
        most=10_000,
        free=True,
    )
    timestep: float = key("length of a physics step (s)", default=TIMESTEP, above=0, most=1)
    integrator: Integrator = key(
        "implicitfast, or implicit: a step takes 1.5 times as long, and bodies that tumble fast gain no"
        " energy from it",
        default=Integrator.implicitfast,
    )
    height_limit: float = key(
        "height of the core (m) beyond which a simulation counts as diverged, and the robot is put back",
        default=HEIGHT_LIMIT,
        above=0,
        most=1_000_000,
    )
    speed_limit: float = key(
        "mean speed of the core along the ground in a control step (m/s), likewise",
        default=SPEED_LIMIT,
        above=0,
        most=1_000_000,
    )
    stiffness: float = key("of the hinges' servos (N·m/rad)", default=STIFFNESS, above=0, most=1000)
    damping: float = key("of the hinges' servos (N·m·s/rad)", default=DAMPING, least=0, most=1000)
    armature: float = key("rotor inertia at a hinge (kg·m²)", default=ARMATURE, least=0, most=10)
    friction: float = key(
        "sliding friction of ground and modules", default=FRICTION, least=0, most=100
    )
    self_collision: bool = key(
        "whether a robot's limbs collide with one another, not only with the ground", default=False
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not re.fullmatch(r"cpu|cuda:\d{1,3}", self.device):
            self.refuse("device", self.device, "cpu, cuda:0, cuda:1, ...")
        if self.backend is PhysicsBackend.warp:
            if self.integrator is not Integrator.implicitfast:
                self.refuse("integrator", "implicit", "implicitfast with physics=warp")
            if self.threads is not None:
                self.refuse("threads", self.threads, "null with physics=warp, which has none")
        elif self.device != "cpu":
            self.refuse("device", self.device, "cpu with physics=threaded; physics=warp uses a GPU")
        elif self.contacts is not None:
            self.refuse(
                "contacts", self.contacts, "null with physics=threaded, which needs no room"
            )

    def require(self) -> None:
        """Looks whether this machine can step robots so; a record of a run may be from another.

        Raises:
            ConfigError: if packages or the device are not there.
        """
        if self.backend is not PhysicsBackend.warp:
            return
        if not all(map(importlib.util.find_spec, ("warp", "mujoco_warp"))):
            raise ConfigError("physics=warp needs packages: pip install 'locomotion[warp]'")
        if self.device != "cpu":
            import torch  # takes seconds, but a run on a GPU has to load it anyway

            there = torch.cuda.device_count()
            if int(self.device.partition(":")[2]) >= there:
                raise ConfigError(
                    f"physics.device={self.device} is not there: torch {torch.__version__} sees"
                    f" {there or 'no'} GPU{'s' * (there > 1)} here; physics.device=cpu needs none"
                )
