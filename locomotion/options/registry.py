"""Registries of all that is chosen by name: readings, rewards, arenas, networks and learners.

A name comes from the project's own module of its kind, from an entry point of an installed package, or
from a plugin, a module that the user names and that registers what it has::

    from locomotion.options.registry import rewards

    @rewards.register("height")
    @dataclasses.dataclass
    class Height: ...

Names in the folder of a run are looked up here, and never imported.
"""

from __future__ import annotations

import functools
import importlib
import inspect
import sys
from collections.abc import Callable, Iterable
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeVar

from locomotion.options.checked import ConfigError, suggestion

T = TypeVar("T")


class Registry:
    """Choices of one kind, by name.

    Args:
        kind: the kind in the singular, for messages.
        group: entry points of installed packages that hold such choices, a name each.
        home: the module that registers the project's own, imported when first needed.
    """

    def __init__(self, kind: str, group: str, home: str) -> None:
        self.kind = kind
        self._group = group
        self._home = home
        self._choices: dict[str, Any] = {}
        self._origins: dict[str, tuple[Any, ...]] = {}

    def register(self, name: str) -> Callable[[T], T]:
        """Makes what it decorates a choice.

        Raises:
            ConfigError: if there is another choice of that name.
        """

        frame = inspect.currentframe()
        module = frame.f_back.f_globals.get("__name__") if frame and frame.f_back else None

        def add(choice: T) -> T:
            # A module that is imported a second time, as in a notebook, replaces what it registered.
            origin = (module, getattr(choice, "__qualname__", None))
            if self._origins.setdefault(name, origin) != origin:
                raise ConfigError(f"there are two {self.kind}s called {name}")
            self._choices[name] = choice
            return choice

        return add

    def names(self) -> list[str]:
        """All choices, in alphabetical order."""
        importlib.import_module(self._home)
        return sorted({*self._choices, *(point.name for point in self._points())})

    def get(self, name: str, key: str | None = None) -> Any:
        """The choice of a name.

        Args:
            name: one of :meth:`names`.
            key: the key that asks for it, for the message.

        Raises:
            ConfigError: if there is none; the message says which there are.
        """
        name = str(name)
        if name not in self._choices:
            importlib.import_module(self._home)
        if name not in self._choices:
            for point in self._points():
                if point.name == name:
                    self._choices[name] = self._load(point)
        if name not in self._choices:
            known = self.names()
            asked, hint = f"{key or self.kind}={name}", suggestion(name, known)
            raise ConfigError(f"{asked} is unknown; {hint}choose from {', '.join(known)}")
        return self._choices[name]

    def _points(self) -> Iterable[EntryPoint]:
        return _entry_points(self._group, tuple(sys.path))

    def _load(self, point: EntryPoint) -> Any:
        try:
            return point.load()
        except Exception as error:
            raise ConfigError(
                f"the {self.kind} {point.name} of {point.value} cannot be loaded: {_reason(error)}"
            ) from error


@functools.cache  # looking into every package that is installed takes long
def _entry_points(group: str, path: tuple[str, ...]) -> Iterable[EntryPoint]:
    return entry_points(group=group)


def _reason(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


def import_plugins(modules: Iterable[str]) -> None:
    """Imports modules that register choices.

    Raises:
        ConfigError: if one is not there, or cannot be imported.
    """
    for module in modules:
        try:
            importlib.import_module(module)
        except ConfigError:
            raise
        except Exception as error:
            raise ConfigError(f"plugins={module} cannot be imported: {_reason(error)}") from error


readings = Registry("reading", "locomotion.readings", "locomotion.envs.readings")
rewards = Registry("reward", "locomotion.rewards", "locomotion.tasks.rewards")
arenas = Registry("arena", "locomotion.arenas", "locomotion.arenas.choices")
networks = Registry("network", "locomotion.networks", "locomotion.agents.architectures")
learners = Registry("learner", "locomotion.learners", "locomotion.agents.learners")
