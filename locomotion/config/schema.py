"""A whole run: the options of each package under their key.

Types, ranges, meanings and defaults stand with the options; ``conf/`` holds the choices. The options of
an arena, a network and a learner are those of the choice that is named.
"""

from __future__ import annotations

import dataclasses
import enum
import typing
from collections.abc import Iterator, Mapping
from typing import Any

from omegaconf import MISSING, OmegaConf

from locomotion.agents.architectures import Network
from locomotion.agents.learners import LearnerConfig
from locomotion.config.logger import LoggerConfig
from locomotion.envs.observations import ObsTerm, check_terms
from locomotion.options import (
    Checked,
    arenas,
    chosen,
    import_plugins,
    key,
    learners,
    networks,
    rewards,
    typed,
)
from locomotion.physics.options import PhysicsConfig
from locomotion.robots.body import RobotConfig
from locomotion.tasks.options import EnvConfig, TaskConfig, substeps


@dataclasses.dataclass
class Config(Checked):
    """A run.

    Attributes:
        learner: the options of the learner that ``algorithm`` names; in a configuration they stand under
            that name, such as ``ppo.gamma``.
        architecture: the network that ``network`` describes.
    """

    robot: RobotConfig = MISSING
    obs: dict[str, ObsTerm] = MISSING
    arena: dict[str, Any] = MISSING
    task: TaskConfig = MISSING
    env: EnvConfig = dataclasses.field(default_factory=EnvConfig)
    physics: PhysicsConfig = dataclasses.field(default_factory=PhysicsConfig)
    algorithm: str = key("the learner, whose keys stand under its name", default="ppo")
    network: dict[str, Any] = MISSING
    logger: LoggerConfig = dataclasses.field(default_factory=LoggerConfig)
    seed: int = key("of everything random", default=0, least=0, most=2**31 - 1)
    checkpoint_interval: int = key(
        "iterations between checkpoints", default=20, least=1, most=1_000_000_000, free=True
    )
    plugins: list[str] = key(
        "modules to import, which register choices of their own", default=[], free=True
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.learner: LearnerConfig = learners.get(self.algorithm, "algorithm")()
        check_terms(self.obs)
        substeps(self.env.control_frequency, self.physics.timestep)
        for name, options in self.task.rewards.items():
            reward = rewards.get(name, "task.rewards")
            typed(reward, options or {}, prefix=f"task.rewards.{name}.")
        chosen(arenas, self.arena, "arena")
        self.architecture: Network = chosen(networks, self.network, "network")


#: The parts of a configuration that are chosen as ``GROUP=OPTION``.
GROUPS = ("robot", "obs", "arena", "task", "physics", "algorithm", "network", "logger")


def typed_config(content: Mapping[str, Any], learning: bool = True) -> Config:
    """A run from plain values, such as a composed configuration.

    Its plugins are imported first, so those of somebody else's record are to be removed before.

    Args:
        content: the values.
        learning: whether something is to be learned, so that numbers of robots and of frames must fit.

    Raises:
        ConfigError: for an unknown key or choice, or a value of the wrong type or range.
    """
    if OmegaConf.is_config(content):
        content = OmegaConf.to_container(content, resolve=True)
    content = dict(content)
    import_plugins(content.get("plugins") or [])
    algorithm = content.get("algorithm", "ppo")
    schema = learners.get(algorithm, "algorithm")
    options = content.pop(str(algorithm), None) or {}
    for other in learners.names():
        content.pop(other, None)  # the options of learners that are not asked for
    config = typed(Config, content)
    config.learner = typed(schema, options, prefix=f"{algorithm}.")
    if learning:
        config.learner.check(config.env.num_envs, config.physics.device)
    return config


def as_dict(config: Config) -> dict[str, Any]:
    """The plain values of a run, as a configuration spells them."""
    content = _plain(config)
    content[config.algorithm] = _plain(config.learner)
    return content


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        fields = dataclasses.fields(value)
        return {field.name: _plain(getattr(value, field.name)) for field in fields}
    if isinstance(value, enum.Enum):
        return value.name
    if isinstance(value, Mapping):
        return {name: _plain(part) for name, part in value.items()}
    return value


def flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Values of nested mappings by keys such as ``ppo.gamma``; lists and empty mappings are values."""
    for name, value in content.items():
        if isinstance(value, dict) and value:
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def free_keys() -> frozenset[str]:
    """The keys that do not change the numbers of a run, such as ``physics.threads``."""
    return frozenset(name for name, field in described(Config) if field.metadata.get("free"))


def described(schema: type, prefix: str = "") -> Iterator[tuple[str, dataclasses.Field]]:
    """The fields of a dataclass and of those in it, by their key in a configuration."""
    types = typing.get_type_hints(schema)
    for field in dataclasses.fields(schema):
        if dataclasses.is_dataclass(types[field.name]):
            yield from described(types[field.name], f"{prefix}{field.name}.")
        else:
            yield f"{prefix}{field.name}", field
