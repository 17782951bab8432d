"""A whole run: the options of each package under their key.

Types, ranges, meanings and defaults stand with the options; ``conf/`` holds the choices. The options of
an arena, a network and a learner are those of the choice that is named.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from omegaconf import MISSING, OmegaConf

from locomotion.agents.architectures import Network
from locomotion.agents.base import LearnerConfig
from locomotion.config.logger import LoggerConfig
from locomotion.disturbances import DisturbancesConfig
from locomotion.envs.observations import ObsTerm, check_terms, typed_terms
from locomotion.options import (
    Checked,
    ConfigError,
    arenas,
    chosen,
    described,
    key,
    learners,
    networks,
    rewards,
    typed,
)
from locomotion.physics.options import PhysicsConfig
from locomotion.robots.body import RobotConfig
from locomotion.tasks.options import EnvConfig, TaskConfig, substeps
from locomotion.tasks.rewards import make_rewards


@dataclasses.dataclass
class Config(Checked):
    """A run.

    Options of what is chosen by name are filled up with their defaults.

    Attributes:
        learner: the options of the learner that ``algorithm`` names, its defaults if it is another's; in
            a configuration they stand under that name, such as ``ppo.gamma``.
        obs: terms by name, each an :class:`~locomotion.envs.observations.ObsTerm`; the policy sees them.
        critic: more terms, which the critic alone sees.
    """

    robot: RobotConfig = MISSING
    obs: dict[str, Any] = dataclasses.field(default_factory=dict)
    critic: dict[str, Any] = dataclasses.field(default_factory=dict)
    arena: dict[str, Any] = dataclasses.field(default_factory=dict)
    task: TaskConfig = MISSING
    env: EnvConfig = dataclasses.field(default_factory=EnvConfig)
    disturbances: DisturbancesConfig = dataclasses.field(default_factory=DisturbancesConfig)
    physics: PhysicsConfig = dataclasses.field(default_factory=PhysicsConfig)
    algorithm: str = key("the learner, whose keys stand under its name", default="ppo")
    network: dict[str, Any] = dataclasses.field(default_factory=dict)
    logger: LoggerConfig = dataclasses.field(default_factory=LoggerConfig)
    seed: int = key("of everything random", default=0, least=0, most=2**31 - 1)
    checkpoint_interval: int = key(
        "iterations between checkpoints", default=20, least=1, most=1_000_000_000, free=True
    )
    plugins: list[str] = key(
        "modules to import, which register choices of their own", default=[], free=True
    )
    learner: LearnerConfig | None = dataclasses.field(
        default=None, metadata={"omegaconf_ignore": True}
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.plugins:
            if name not in sys.modules:  # a file is data, and cannot run code
                raise ConfigError(
                    f"plugins={name} has not been imported; +plugins=[{name}] does that"
                )
        schema = learners.get(self.algorithm, "algorithm")
        if not isinstance(self.learner, schema):
            self.learner = schema()
        self.obs, self.critic = typed_terms(self.obs), typed_terms(self.critic, "critic")
        if not self.obs:
            raise ConfigError("obs has no term, so the policy would observe nothing")
        check_terms(self.obs)
        check_terms(self.critic, "critic")
        substeps(self.env.control_frequency, self.physics.timestep)
        terms = zip(self.task.rewards, make_rewards(self.task.rewards), strict=True)
        whole = {name: plain(reward) for name, reward in terms}
        self.task = dataclasses.replace(self.task, rewards=whole)
        for name, registry in (("arena", arenas), ("network", networks)):
            options = getattr(self, name)
            made = chosen(registry, options, name)
            setattr(self, name, {"name": options["name"], **plain(made)})

    @property
    def architecture(self) -> Network:
        """The network that ``network`` describes."""
        return chosen(networks, self.network, "network")


#: The parts of a configuration that are chosen as ``GROUP=OPTION``.
GROUPS = (
    *("robot", "obs", "critic", "arena", "task", "disturbances", "physics", "algorithm", "network"),
    "logger",
)


def typed_config(content: Mapping[str, Any], learning: bool = True) -> Config:
    """A run from plain values, such as a composed configuration.

    Its plugins have been imported, as the command line does; those of somebody else's record are to be
    removed before.

    Args:
        content: the values.
        learning: whether something is to be learned, so that numbers of robots and of frames must fit.

    Raises:
        ConfigError: for an unknown key or choice, or a value of the wrong type or range.
    """
    if OmegaConf.is_config(content):
        content = OmegaConf.to_container(content, resolve=True)
    content = dict(content)
    algorithm = content.get("algorithm", "ppo")
    schema = learners.get(algorithm, "algorithm")
    options = content.pop(str(algorithm), None) or {}
    for other in learners.names():
        content.pop(other, None)  # the options of learners that are not asked for
    config = typed(Config, content)
    config.learner = typed(schema, options, prefix=f"{algorithm}.")
    if learning:
        config.learner.check(config.env, config.physics.device)
        config.learner.check_network(config.architecture)
    return config


def as_dict(config: Config) -> dict[str, Any]:
    """The plain values of a run, as a configuration spells them."""
    return {**plain(config), config.algorithm: plain(config.learner)}


def plain(options: Any) -> dict[str, Any]:
    """The plain values of an instance of a dataclass."""
    return OmegaConf.to_container(OmegaConf.structured(options), enum_to_str=True)


def all_keys() -> Iterator[tuple[str, dataclasses.Field]]:
    """The keys of a run and of all that it can be made of; a key of several choices is there for each."""
    yield from described(Config)
    yield from described(ObsTerm, "obs.TERM.")
    places = {learners: "{}.", networks: "network.", arenas: "arena.", rewards: "task.rewards.{}."}
    for registry, place in places.items():
        for name in registry.names():
            yield from described(registry.get(name), place.format(name))


def free_keys() -> frozenset[str]:
    """The keys that do not change the numbers of a run, such as ``physics.threads``."""
    free: dict[str, bool] = {}
    for name, field in all_keys():
        free[name] = free.get(name, True) and bool(field.metadata.get("free"))
    return frozenset(name for name in free if free[name])
