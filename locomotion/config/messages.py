"""One line about what is wrong with a configuration, from what OmegaConf and PyYAML raise."""

from __future__ import annotations

import dataclasses
import difflib
from pathlib import Path

import yaml
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException


def explain_omegaconf(error: OmegaConfBaseException, prefix: str = "") -> str:
    """One line about a key or value that a schema does not accept.

    Args:
        error: what OmegaConf raised.
        prefix: where the schema stands in the configuration, such as ``"ppo."``.
    """
    key = f"{prefix}{error.full_key}"
    if isinstance(error, (ConfigAttributeError, ConfigKeyError)):
        if not dataclasses.is_dataclass(error.object_type):  # Hydra's own part
            return f"{key} is no key"
        known = [field.name for field in dataclasses.fields(error.object_type)]
        parent, dot, name = key.rpartition(".")
        close = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {parent}{dot}{close[0]}? " if close else ""
        return f"{key} is no key; {hint}allowed are {', '.join(known)}"
    return f"{key}: {str(error.msg).splitlines()[0]}"


def explain_yaml(error: yaml.YAMLError) -> str:
    """One line about a file that is no proper YAML, or that uses a face of a module twice."""
    if not isinstance(error, yaml.MarkedYAMLError):
        return " ".join(str(error).split())
    file, line = Path(error.problem_mark.name), error.problem_mark.line + 1
    if "duplicate key" in str(error.problem) and file.is_file():
        keys = _duplicate_key(yaml.compose(file.read_text()))
        if keys and keys[0] == "body" and keys[-2] == "children":
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
