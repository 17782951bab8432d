"""Reading ``conf/``, and YAML files like those in it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import yaml
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from locomotion.options.checked import ConfigError
from locomotion.options.typed import typed

T = TypeVar("T")


def conf_dir() -> Path:
    """The folder ``conf/``: inside the installed package, or next to it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    return next(path for path in (package / "conf", package.parent / "conf") if path.is_dir())


def choices(group: str) -> list[str]:
    """The choices of a group in ``conf/``."""
    return sorted(file.stem for file in (conf_dir() / group).glob("*.yaml"))


def read_choice(group: str, name: str) -> dict[str, Any]:
    """The values of a choice in ``conf/``, such as ``read_choice("robot", "gecko")``.

    Raises:
        ConfigError: if there is none; the message says which there are.
    """
    if name not in choices(group):
        raise ConfigError(f"{group}={name} is unknown; choose from {', '.join(choices(group))}")
    return read_yaml(conf_dir() / group / f"{name}.yaml")


def load_file(path: Path, schema: type[T], **defaults: Any) -> T:
    """Reads a YAML file into a dataclass, with these values where it has none.

    Raises:
        ConfigError: for a file that is missing or not YAML, an unknown key, or a value of the wrong
            type or range.
    """
    try:
        return typed(schema, {**defaults, **read_yaml(path)})
    except ConfigError as error:
        raise error if str(path.name) in str(error) else ConfigError(f"{path}: {error}") from error


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file, as plain values.

    Raises:
        ConfigError: for a file that is missing, or not YAML in UTF-8, or holds something else.
    """
    try:
        content = OmegaConf.to_container(OmegaConf.create(path.read_text(encoding="utf-8")))
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} is not text in UTF-8") from error
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except yaml.YAMLError as error:
        raise ConfigError(explain_yaml(error, path)) from error
    except RecursionError as error:
        raise ConfigError(f"{path} is nested too deeply") from error
    except OmegaConfBaseException as error:
        raise ConfigError(f"{path}: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path} does not hold keys and values")
    return content


def explain_yaml(error: yaml.YAMLError, path: Path | None = None) -> str:
    """One line about a file that is not proper YAML, or that uses a face of a module twice."""
    if not isinstance(error, yaml.MarkedYAMLError):
        where = f"{path}: " if path else ""
        return where + " ".join(str(error).split())
    file, line = path or Path(error.problem_mark.name), error.problem_mark.line + 1
    if "duplicate key" in str(error.problem) and file.is_file():
        keys = _duplicate_key(yaml.compose(file.read_text(encoding="utf-8")))
        if keys and keys[0] == "body" and keys[-2:-1] == ["children"]:
            module = "/".join(["core", *keys[2:-2:2]])
            return f"{file}, line {line}: {module}: two children on the face {keys[-1]!r}"
    return f"{file}, line {line}: {error.problem}"


def _duplicate_key(node: yaml.Node) -> list[str] | None:
    """The keys that lead to the first key which its mapping holds twice."""
    if not isinstance(node, yaml.MappingNode):
        return None
    seen = set()
    for key, value in node.value:
        if key.value in seen:
            return [key.value]
        seen.add(key.value)
        below = _duplicate_key(value)
        if below is not None:
            return [key.value, *below]
    return None
