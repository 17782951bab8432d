"""Names for what a policy observes: those of ``conf/obs``, or a description."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

from locomotion.envs.observations import ObsTerm, Representation, typed_terms
from locomotion.options import choices, read_choice

Terms = dict[str, ObsTerm]


def observations_name(terms: Mapping[str, Any]) -> str:
    """The name that ``+obs=NAME`` has for some terms, or a description such as ``5 steps + gravity``.

    Args:
        terms: by name, as in the ``obs`` of a configuration.

    Raises:
        ConfigError: if they are not terms.
    """
    found = _typed(terms)
    for name, known in _choices().items():
        if known == found:
            return name
    return _description(found)


def observations_label(name: str) -> str:
    """A name from :func:`observations_name`, with its meaning."""
    choice = _choices().get(name)
    return name if choice is None else f"{name}: {_description(choice)}"


def _typed(terms: Mapping[str, Any]) -> Terms:
    found = typed_terms(terms)
    for term in found.values():  # the quaternion is how an orientation is read
        if term.representation is Representation.quaternion:
            term.representation = None
    return found


def _description(terms: Terms) -> str:
    parts = []
    for name, term in terms.items():
        reading, words = term.reading_of(name), []
        if reading == "hinge_position" or term.steps > 1:
            words.append("1 step" if term.steps == 1 else f"{term.steps} steps")
        if reading not in ("hinge_position", "core_orientation"):
            words.append(reading.replace("_", " "))
        if term.representation is not None:
            words.append(term.representation.value)
        elif reading == "core_orientation":
            words.append("orientation")
        if term.scale != 1.0:
            words.append(f"x {term.scale:g}")
        parts.append(" ".join(words))
    return " + ".join(parts)


@functools.cache
def _choices() -> dict[str, Terms]:
    return {name: _typed(read_choice("obs", name)) for name in choices("obs")}
