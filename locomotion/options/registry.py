"""What can be chosen by name: readings, rewards, arenas, networks and learners.

A name comes from the project's own module of its kind, from an entry point of an installed package, or
from a plugin, a module that the user names and that registers what it has::

    from locomotion.options.registry import rewards

    @rewards.register("height")
    @dataclasses.dataclass
    class Height: ...

Names in the folder of a run are looked up here, and never imported.
"""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Callable, Iterable
from importlib.metadata import entry_points
from typing import Any, TypeVar

from locomotion.options.checked import ConfigError

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

    def register(self, name: str) -> Callable[[T], T]:
        """Makes what it decorates a choice.

        Raises:
            ConfigError: if there is another choice of that name.
        """

        def add(choice: T) -> T:
            known = self._choices.setdefault(name, choice)
            # A module that is imported a second time, as in a notebook, replaces what it registered.
            if _origin(known) != _origin(choice):
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
        if name not in self._choices:
            importlib.import_module(self._home)
        if name not in self._choices:
            for point in self._points():
                if point.name == name:
                    self._choices[name] = point.load()
        if name not in self._choices:
            known = self.names()
            close = difflib.get_close_matches(str(name), known, n=1)
            hint = f"did you mean {close[0]}? " if close else ""
            raise ConfigError(
                f"{key or self.kind}={name} is unknown; {hint}choose from {', '.join(known)}"
            )
        return self._choices[name]

    def _points(self) -> Iterable[Any]:
        return entry_points(group=self._group)


def _origin(choice: Any) -> tuple[str, str]:
    return (
        getattr(choice, "__module__", ""),
        getattr(choice, "__qualname__", repr(choice)),
    )


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
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise ConfigError(f"plugins={module} cannot be imported: {reason}") from error


readings = Registry("reading", "locomotion.readings", "locomotion.envs.readings")
rewards = Registry("reward", "locomotion.rewards", "locomotion.tasks.rewards")
arenas = Registry("arena", "locomotion.arenas", "locomotion.arenas.choices")
networks = Registry("network", "locomotion.networks", "locomotion.agents.architectures")
learners = Registry("learner", "locomotion.learners", "locomotion.agents.learners")
