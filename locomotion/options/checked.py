"""Typed options: dataclasses whose fields have a meaning and a range, and that check themselves.

Each package of the project declares its options with these, next to what they are for. A value out of
range is refused in the same words on the command line and from Python.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import math
import numbers
import typing
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from omegaconf import MISSING


class ConfigError(ValueError):
    """A configuration that cannot be used; the message is one line that names the key."""


def suggestion(name: str, known: Iterable[str], prefix: str = "") -> str:
    """A question for a message, about the name that was meant; empty if none is like it."""
    close = difflib.get_close_matches(name, [*known], n=1)
    return f"did you mean {prefix}{close[0]}? " if close else ""


def key(
    meaning: str,
    *,
    default: Any = MISSING,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    free: bool = False,
) -> Any:
    """Declares an option.

    Args:
        meaning: for ``--help``, with the unit.
        default: its value; a mutable one is copied for each instance. Required without.
        above: the value must be greater.
        least: smallest value.
        most: largest value.
        free: whether a run has the same numbers whatever the value.
    """
    metadata = {"meaning": meaning, "above": above, "least": least, "most": most, "free": free}
    if isinstance(default, (list, dict)):
        kind = type(default)
        return dataclasses.field(default_factory=lambda: kind(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def limits(field: dataclasses.Field) -> list[str]:
    """The limits of an option in words."""
    words = {"above": "above", "least": "at least", "most": "at most"}
    bounds = ((word, field.metadata.get(name)) for name, word in words.items())
    return [f"{word} {bound:g}" for word, bound in bounds if bound is not None]


_hints = functools.cache(typing.get_type_hints)


def fitted(kind: Any, value: Any) -> Any:
    """A value with numbers of Python: numpy's become those, and 2.0 an integer where one is meant.

    Args:
        kind: the type that is wanted, such as ``int | None`` or a dataclass.
        value: a number, or mappings and lists of them; anything else is returned as it is.
    """
    if dataclasses.is_dataclass(kind) and isinstance(value, Mapping):
        kinds = _hints(kind)
        return {name: fitted(kinds.get(name), part) for name, part in value.items()}
    inner = typing.get_args(kind)
    if isinstance(value, Mapping):
        return {name: fitted(inner[-1] if inner else None, part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [fitted(inner[0] if inner else None, part) for part in value]
    if isinstance(value, np.generic):
        value = value.item()
    wanted = {kind, *inner}
    integral = isinstance(value, float) and value.is_integer()
    return int(value) if integral and int in wanted and float not in wanted else value


class Checked:
    """Checks every field against the range in its metadata when an instance is made.

    Subclasses are dataclasses. One with rules of its own extends ``__post_init__`` and calls
    :meth:`refuse`.
    """

    #: Where the keys stand in the configuration, for messages.
    PREFIX = ""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            for number in value if isinstance(value, (list, tuple)) else (value,):
                self._check_range(field, number, value)

    def _check_range(self, field: dataclasses.Field, number: Any, value: Any) -> None:
        if isinstance(number, bool) or not isinstance(number, numbers.Real):
            return
        bounds = field.metadata
        inside = (
            math.isfinite(number)
            and (bounds.get("above") is None or number > bounds["above"])
            and (bounds.get("least") is None or number >= bounds["least"])
            and (bounds.get("most") is None or number <= bounds["most"])
        )
        if not inside:
            self.refuse(field.name, value, " and ".join(limits(field)) or "finite")

    def refuse(self, name: str, value: Any, wanted: str) -> None:
        """Raises a :class:`ConfigError` that names a field, its value and what it must be."""
        raise ConfigError(f"{self.PREFIX}{name}={value} must be {wanted}")
