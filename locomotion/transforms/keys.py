"""Keys and entries of tensordicts, with errors that name them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextvars import ContextVar
from typing import Any

from tensordict import is_tensor_collection
from tensordict.utils import NestedKey, unravel_key
from torchrl.data import Composite, TensorSpec
from torchrl.envs import EnvBase, ObservationTransform, Transform, TransformedEnv

#: Whether a transform looks at its entries. TorchRL then makes the environment before it anew, with copies of
#: all earlier transforms; if these looked too, time would double with each transform.
_looking: ContextVar[bool] = ContextVar("looking", default=False)


class EntryTransform(ObservationTransform):
    """A transform that looks at the entries it is to read as soon as it is added to an environment."""

    def set_container(self, container: Transform | EnvBase) -> None:
        """Adds the transform to an environment, or to a chain of transforms.

        Raises:
            KeyError: if an entry of ``in_keys`` is not there.
            ValueError: if one is of the wrong kind.
        """
        super().set_container(container)
        if _looking.get():
            return
        token = _looking.set(True)
        try:
            self.look(self.parent)
        finally:
            self.empty_cache()
            _looking.reset(token)

    def look(self, parent: TransformedEnv | None) -> None:
        """Looks at the environment that it was added to, without it and what follows.

        Args:
            parent: ``None`` for a chain that is in no environment yet.
        """
        if parent is None:
            return
        try:
            spec = parent.observation_spec
        except RuntimeError:
            # One before it has no statistics yet, as a lazy ObservationNorm; later, specs are asked for.
            return
        self.transform_observation_spec(spec.clone())


def as_keys(keys: Sequence[NestedKey] | NestedKey, name: str) -> list[NestedKey]:
    """A list of keys; as in TorchRL, a string or a tuple is one key.

    Raises:
        ValueError: if there is none, one is not a key, or one comes twice.
    """
    listed = [keys] if isinstance(keys, (str, tuple)) else keys
    if not isinstance(listed, Iterable) or not all(map(_is_key, listed := [*listed])):
        raise ValueError(f"{name} must be a key or a list of keys, got {keys!r}")
    found = [unravel_key(key) for key in listed]
    if not found or len({*found}) != len(found):
        raise ValueError(f"{name} must be one key or more, none of them twice, got {keys!r}")
    return found


def _is_key(key: Any) -> bool:
    return isinstance(key, str) or (isinstance(key, tuple) and key != () and all(map(_is_key, key)))


def pairs_of_keys(
    in_keys: Sequence[NestedKey] | NestedKey, out_keys: Sequence[NestedKey] | NestedKey
) -> tuple[list[NestedKey], list[NestedKey]]:
    """Two lists of keys, as long as one another.

    Raises:
        ValueError: if they are not, or are no keys.
    """
    in_keys, out_keys = as_keys(in_keys, "in_keys"), as_keys(out_keys, "out_keys")
    if len(out_keys) != len(in_keys):
        raise ValueError(f"got {len(in_keys)} in_keys but {len(out_keys)} out_keys")
    return in_keys, out_keys


def entry(container: Any, key: NestedKey, transform: object) -> Any:
    """An entry of a tensordict or of a spec.

    Raises:
        KeyError: if it is not there; the message says which entries are.
    """
    found = container.get(key, None)
    if found is None or isinstance(found, Composite) or is_tensor_collection(found):
        there = ", ".join(sorted(repr(name) for name in container.keys(True, True)))
        raise KeyError(
            f"{type(transform).__name__}: no entry {key!r}; in_keys must be among {there}"
        )
    return found


def vector(container: Any, key: NestedKey, transform: object) -> Any:
    """An entry of a tensordict or of a spec that has a dimension of its own.

    Raises:
        KeyError: if it is not there.
        ValueError: if it is a number for each element of the batch.
    """
    found = entry(container, key, transform)
    around = container if isinstance(key, str) else container.get(key[:-1])
    if found.ndim <= around.ndim:
        raise ValueError(
            f"{type(transform).__name__}: {key!r} is a number, not a vector;"
            " UnsqueezeTransform(-1) makes it one"
        )
    return found


def require_floating(spec: TensorSpec, key: NestedKey, transform: object) -> None:
    """Raises a :class:`ValueError` if an entry does not hold floating point numbers."""
    if not spec.dtype.is_floating_point:
        raise ValueError(
            f"{type(transform).__name__}: {key!r} holds {spec.dtype}, not floating point numbers"
        )
