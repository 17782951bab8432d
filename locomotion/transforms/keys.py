"""Keys and entries of tensordicts, with errors that name them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tensordict.utils import NestedKey, unravel_key


def as_keys(keys: Sequence[NestedKey] | NestedKey) -> list[NestedKey]:
    """A list of keys; as in TorchRL, a string or a tuple is one key."""
    return [unravel_key(key) for key in ([keys] if isinstance(keys, (str, tuple)) else keys)]


def entry(container: Any, key: NestedKey, transform: object) -> Any:
    """An entry of a tensordict or of a spec.

    Raises:
        KeyError: if it is not there; the message says which entries are.
    """
    found = container.get(key, None)
    if found is None:
        there = ", ".join(sorted(repr(name) for name in container.keys(True, True)))
        raise KeyError(
            f"{type(transform).__name__}: no entry {key!r}; in_keys must be among {there}"
        )
    return found
