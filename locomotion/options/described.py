"""The options of a schema by their keys, with their meanings."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Iterator, Mapping
from typing import Any

from locomotion.options.checked import limits


def described(schema: type, prefix: str = "") -> Iterator[tuple[str, dataclasses.Field]]:
    """The fields of a dataclass and of those in it, by their key in a configuration."""
    types = typing.get_type_hints(schema)
    for field in dataclasses.fields(schema):
        if field.metadata.get("omegaconf_ignore"):
            continue  # no key of its own
        if dataclasses.is_dataclass(types[field.name]):
            yield from described(types[field.name], f"{prefix}{field.name}.")
        else:
            yield f"{prefix}{field.name}", field


def summary(field: dataclasses.Field) -> str:
    """Meaning, range and default of an option, in a line."""
    default = field.default
    if field.default_factory is not dataclasses.MISSING:
        default = field.default_factory()
    shown = getattr(default, "name", default)
    shown = "null" if shown is None else str(shown).lower() if isinstance(shown, bool) else shown
    text = "; ".join([field.metadata["meaning"], *filter(None, [", ".join(limits(field))])])
    return text if shown == "???" else f"{text} [{shown}]"


def flat(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Values of nested mappings by keys such as ``ppo.gamma``; lists and empty mappings are values."""
    for name, value in content.items():
        if isinstance(value, dict) and value:
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value
