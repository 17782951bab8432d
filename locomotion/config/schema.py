"""What a run is made of: one typed dataclass for each part of ``conf/``.

Types, ranges and meanings stand here, values in ``conf/``. The dataclasses check themselves, so a
value out of range is refused in the same words on the command line and from Python.
"""

from __future__ import annotations

import dataclasses
import enum
import importlib.util
import math
import re
from typing import Any

from omegaconf import MISSING

#: Most frames of an iteration; with a few hundred bytes each they fill a large machine's memory.
MOST_FRAMES = 2**27


class ConfigError(ValueError):
    """A configuration that cannot be used; the message is one line that names the key."""


def key(
    meaning: str,
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    free: bool = False,
    before: Any = MISSING,
) -> Any:
    """A required key: what it means, and the range of its value (``None`` is not checked).

    ``free`` says that a run has the same numbers whatever the value; ``before``, for a key that is
    younger than some runs, what their records mean by not having it.
    """
    limits = {"above": above, "least": least, "most": most}
    return dataclasses.field(default=before, metadata={"meaning": meaning, "free": free, **limits})


class Checked:
    """Checks every field against the range in its metadata when an instance is made."""

    #: Where the keys stand in the configuration, for messages.
    PREFIX = ""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            self._check_range(field, getattr(self, field.name))

    def _check_range(self, field: dataclasses.Field, value: Any) -> None:
        if value is None or isinstance(value, bool) or not isinstance(value, (int, float)):
            return
        limits = field.metadata
        wanted = [
            f"{words} {limits[name]:g}"
            for name, words in (("above", "above"), ("least", "at least"), ("most", "at most"))
            if limits.get(name) is not None
        ]
        inside = (
            math.isfinite(value)
            and (limits.get("above") is None or value > limits["above"])
            and (limits.get("least") is None or value >= limits["least"])
            and (limits.get("most") is None or value <= limits["most"])
        )
        if not inside:
            self._refuse(field.name, value, " and ".join(wanted) or "finite")

    def _refuse(self, name: str, value: Any, wanted: str) -> None:
        raise ConfigError(f"{self.PREFIX}{name}={value} must be {wanted}")


class Orientation(enum.Enum):
    """How the core's orientation is shown to the policy."""

    quaternion = "quaternion"
    rotation_6d = "rotation_6d"
    gravity = "gravity"
    yaw = "yaw"


class LoggerBackend(enum.Enum):
    """Where metrics go beside ``metrics.csv``, which is always written."""

    csv = "csv"
    tensorboard = "tensorboard"
    wandb = "wandb"


class PhysicsBackend(enum.Enum):
    """What steps the robots."""

    threaded = "threaded"
    warp = "warp"


@dataclasses.dataclass
class RobotConfig(Checked):
    """A robot: its name and the tree of its modules (see :mod:`locomotion.robots.body`)."""

    PREFIX = "robot."

    name: str = key("name of the robot, in run folders and in the compiled model")
    body: dict[str, Any] = key("tree of modules: module, rotation (degrees), children by face")

    def __post_init__(self) -> None:
        from locomotion.robots.body import BodyError, parse_body

        if not self.name or "/" in self.name:
            self._refuse("name", repr(self.name), "a non-empty name without '/'")
        try:
            parse_body(self.body)
        except BodyError as error:
            raise ConfigError(f"robot {self.name}: {error}") from error


@dataclasses.dataclass
class ObsConfig(Checked):
    """What the policy observes."""

    PREFIX = "obs."

    hinge_steps: int = key("how many of the last hinge positions, newest first", least=1, most=1000)
    orientation: Orientation | None = key(
        "the core's orientation as quaternion, rotation_6d, gravity or yaw; null leaves it out"
    )


@dataclasses.dataclass
class EnvConfig(Checked):
    """The task."""

    PREFIX = "env."

    num_envs: int = key("robots that are stepped together", least=1, most=1_000_000)
    control_frequency: float = key("actions a second (Hz)", above=0, most=1000)
    settle_time: float = key(
        "at the start, how long (s) a robot settles under random targets", least=0, most=3600
    )
    time_limit: float | None = key(
        "length of an episode (s), then a reset; null: robots walk on for ever",
        above=0,
        most=1_000_000_000,
    )
    target_limit: float = key(
        "how far (rad) a hinge can be sent to either side; what is further is clipped",
        above=0,
        most=1.0471975511965976,  # a third of pi, where the hinges end
        before=1.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.step_limit == 0:
            self._refuse(
                "time_limit",
                self.time_limit,
                f"at least {1 / self.control_frequency:g}, one action",
            )

    @property
    def step_limit(self) -> int | None:
        """Control steps in an episode; ``None`` if it never ends."""
        return None if self.time_limit is None else round(self.time_limit * self.control_frequency)


@dataclasses.dataclass
class PhysicsConfig(Checked):
    """How bodies move and what steps them."""

    PREFIX = "physics."
    #: The keys that say what steps the bodies; the others say what they are made of.
    STEPPING = ("backend", "device", "contacts", "threads")

    backend: PhysicsBackend = key(
        "threaded: MuJoCo on the CPU; warp: MuJoCo Warp, on a GPU",
        before=PhysicsBackend.threaded,
    )
    device: str = key("where robots and learner are: cpu, or cuda:0 with warp", before="cpu")
    contacts: int | None = key(
        "with warp, contacts at once that each robot has room for; null: what its model suggests",
        least=1,
        most=10_000,
        free=True,
        before=None,
    )
    timestep: float = key("length of a physics step (s)", above=0, most=1)
    threads: int | None = key(
        "threads that step robots; null: one for each core", least=1, most=4096, free=True
    )
    stiffness: float = key("of the hinges' servos (N·m/rad)", above=0, most=1000)
    damping: float = key("of the hinges' servos (N·m·s/rad)", least=0, most=1000)
    armature: float = key("rotor inertia at a hinge (kg·m²)", least=0, most=10)
    friction: float = key("sliding friction of ground and modules", least=0, most=100)
    self_collision: bool = key(
        "whether modules collide with one another, not only with the ground", before=False
    )
    mass_scale: float = key("factor on the masses of all modules", above=0, most=1000, before=1.0)
    strength_scale: float = key(
        "factor on the torque of all servos", above=0, most=1000, before=1.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not re.fullmatch(r"cpu|cuda:\d{1,3}", self.device):
            self._refuse("device", self.device, "cpu, cuda:0, cuda:1, ...")
        if self.backend is PhysicsBackend.warp:
            if self.threads is not None:
                self._refuse("threads", self.threads, "null with physics=warp, which has none")
        elif self.device != "cpu":
            self._refuse(
                "device", self.device, "cpu with physics=threaded; physics=warp uses a GPU"
            )
        elif self.contacts is not None:
            self._refuse(
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


@dataclasses.dataclass
class PPOConfig(Checked):
    """Proximal policy optimisation (Schulman et al. 2017)."""

    PREFIX = "ppo."

    iterations: int = key("rounds of collecting and learning", least=1, most=1_000_000_000)
    steps: int = key("control steps each robot takes in an iteration", least=1, most=1_000_000)
    epochs: int = key("passes over the data of an iteration", least=1, most=1_000_000)
    minibatch_size: int = key("frames in a gradient step", least=1, most=1_000_000_000)
    actor_lr: float = key("Adam's learning rate for the actor at the start", above=0, most=10)
    critic_lr: float = key("Adam's learning rate for the critic at the start", above=0, most=10)
    gamma: float = key("discount per control step", least=0, most=1)
    gae_lambda: float = key("lambda of generalised advantage estimation", least=0, most=1)
    clip_epsilon: float = key("how far the probability ratio may leave 1", above=0, most=0.99)
    entropy_coeff: float = key(
        "weight of the policy's entropy, averaged over the hinges", least=0, most=100
    )
    cudagraphs: bool = key(
        "whether a gradient step is one captured CUDA graph; needs cuda:0", before=False
    )


@dataclasses.dataclass
class LoggerConfig(Checked):
    """Where metrics are shown."""

    PREFIX = "logger."

    backend: LoggerBackend = key(
        "csv: metrics.csv alone; tensorboard or wandb: shown there too", free=True
    )
    video_seconds: float = key(
        "length of the film at the end (s), for tensorboard and wandb; 0: none",
        least=0,
        most=3600,
        free=True,
        before=0.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        name = self.backend.value
        if self.backend is not LoggerBackend.csv and not importlib.util.find_spec(name):
            raise ConfigError(f"logger={name} needs a package: pip install {name}")
        if self.backend is LoggerBackend.csv and self.video_seconds:
            self._refuse("video_seconds", self.video_seconds, "0 with logger=csv, which shows none")


@dataclasses.dataclass
class Config(Checked):
    """A whole run."""

    robot: RobotConfig = MISSING
    obs: ObsConfig = MISSING
    env: EnvConfig = MISSING
    physics: PhysicsConfig = MISSING
    ppo: PPOConfig = MISSING
    logger: LoggerConfig = MISSING
    seed: int = key("of everything random", least=0, most=2**31 - 1)
    checkpoint_interval: int = key(
        "iterations between checkpoints", least=1, most=1_000_000_000, free=True
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        substeps(self.env.control_frequency, self.physics.timestep)
        frames = self.env.num_envs * self.ppo.steps
        if frames > MOST_FRAMES:
            raise ConfigError(
                f"env.num_envs={self.env.num_envs} x ppo.steps={self.ppo.steps} must be at most"
                f" {MOST_FRAMES} frames in an iteration"
            )
        if self.ppo.cudagraphs and self.physics.device != "cuda:0":
            raise ConfigError(
                f"ppo.cudagraphs=True needs physics.device=cuda:0, not {self.physics.device};"
                " CUDA_VISIBLE_DEVICES says which GPU that is"
            )
        if self.ppo.cudagraphs and frames % self.ppo.minibatch_size:
            raise ConfigError(
                f"ppo.minibatch_size={self.ppo.minibatch_size} must divide the {frames} frames of an"
                " iteration with ppo.cudagraphs=True, as all minibatches of a graph have one size"
            )
        if self.ppo.minibatch_size > frames:
            raise ConfigError(
                f"ppo.minibatch_size={self.ppo.minibatch_size} must be at most the {frames} frames"
                f" of an iteration (env.num_envs={self.env.num_envs} x ppo.steps={self.ppo.steps})"
            )


def substeps(control_frequency: float, timestep: float) -> int:
    """Physics steps in a control step.

    Raises:
        ConfigError: if the control period is no multiple of the timestep.
    """
    exact = 1 / (control_frequency * timestep)
    if round(exact) < 1 or abs(exact - round(exact)) > 1e-6 * exact:
        raise ConfigError(
            f"physics.timestep={timestep} must divide the control period of"
            f" {1 / control_frequency:g} s (env.control_frequency={control_frequency})"
        )
    if round(exact) > 1_000_000:
        raise ConfigError(
            f"physics.timestep={timestep} must be at least a millionth of the control period of"
            f" {1 / control_frequency:g} s (env.control_frequency={control_frequency})"
        )
    return round(exact)
