"""Learns a gait: ``python -m locomotion.train robot=gecko +obs=history3``."""

from __future__ import annotations

import sys
import types
from typing import Any

from locomotion.cli.training import main


class _Callable(types.ModuleType):
    """A module that can be called as the function of its name, :func:`locomotion.train`.

    Importing a module ``locomotion.train`` puts it in the function's place.
    """

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        from locomotion.training.execute import execute

        return execute(*args, **kwargs)


sys.modules[__name__].__class__ = _Callable

if __name__ == "__main__":
    main()
