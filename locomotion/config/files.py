"""Reading ``conf/``, and files like those in it, into the dataclasses of the schema."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from locomotion.config.messages import explain_omegaconf, explain_yaml
from locomotion.config.schema import (
    ConfigError,
    LoggerConfig,
    ObsConfig,
    PhysicsConfig,
    PPOConfig,
    RobotConfig,
)

T = TypeVar("T")

GROUPS = {
    "robot": RobotConfig,
    "obs": ObsConfig,
    "physics": PhysicsConfig,
    "ppo": PPOConfig,
    "logger": LoggerConfig,
}


def conf_dir() -> Path:
    """The folder ``conf/``: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    return next(path for path in (package / "conf", package.parent / "conf") if path.is_dir())


def load(choice: str, overrides: Mapping[str, Any] | None = None) -> Any:
    """Reads one choice of a configuration group, as a Python user would without Hydra.

    Args:
        choice: group and option, such as ``"physics/threaded"`` or ``"robot/gecko"``.
        overrides: keys to change.

    Returns:
        The group's dataclass, such as :class:`PhysicsConfig`.

    Raises:
        ConfigError: for an unknown option or key, or a value of the wrong type or range.
    """
    group, _, option = choice.partition("/")
    known = sorted(file.stem for file in (conf_dir() / group).glob("*.yaml"))
    if option not in known:
        raise ConfigError(f"{group}={option} is unknown; choose from {', '.join(known)}")
    return load_file(conf_dir() / f"{choice}.yaml", GROUPS[group], overrides)


def load_file(path: Path, schema: type[T], overrides: Mapping[str, Any] | None = None) -> T:
    """Reads a YAML file into a dataclass of the schema.

    Raises:
        ConfigError: for a file that is missing or no YAML, an unknown key, or a value of the wrong
            type or range.
    """
    try:
        content = OmegaConf.load(path)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except yaml.YAMLError as error:
        raise ConfigError(explain_yaml(error)) from error
    return typed(schema, content, overrides or {})


def typed(schema: type[T], *layers: Any) -> T:
    """Merges mappings, the last of which wins, into an instance of a dataclass of the schema.

    Raises:
        ConfigError: for an unknown key, or a value of the wrong type or range.
    """
    try:
        # Plain containers: a DictConfig could smuggle in keys that the schema does not have.
        plain = [
            OmegaConf.to_container(layer, resolve=True) if OmegaConf.is_config(layer) else layer
            for layer in layers
        ]
        return OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(schema), *plain))
    except RecursionError as error:
        prefix = getattr(schema, "PREFIX", "")
        raise ConfigError(
            f"{prefix.rstrip('.') or 'the configuration'} is nested too deeply"
        ) from error
    except OmegaConfBaseException as error:
        raise ConfigError(explain_omegaconf(error, getattr(schema, "PREFIX", ""))) from error


def flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Values of nested mappings by keys such as ``ppo.gamma``; lists and empty mappings are values."""
    for key, value in content.items():
        if isinstance(value, dict) and value:
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
