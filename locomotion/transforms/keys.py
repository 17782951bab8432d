"""Keys and entries of tensordicts, with errors that name them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tensordict.utils import NestedKey, unravel_key


def as_keys(keys: Sequence[NestedKey] | NestedKey) -> list[NestedKey]:
    """A list of keys; as in TorchRL, a string or a tuple is one key."""
    return [unravel_key(key) for key in ([keys] if isinstance(keys, (str, tuple)) else keys)]


def pairs_of_keys(
    in_keys: Sequence[NestedKey] | NestedKey, out_keys: Sequence[NestedKey] | NestedKey
) -> tuple[list[NestedKey], list[NestedKey]]:
    """Two lists of keys, as long as one another.

    Raises:
        ValueError: if they are not.
    """
    in_keys, out_keys = as_keys(in_keys), as_keys(out_keys)
    if len(out_keys) != len(in_keys):
        raise ValueError(f"got {len(in_keys)} in_keys but {len(out_keys)} out_keys")
    return in_keys, out_keys


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
