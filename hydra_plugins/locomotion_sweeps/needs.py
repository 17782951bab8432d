"""Requirements of launchers: a missing one ends the command with one line."""

from __future__ import annotations

import importlib.util
import sys
from typing import NoReturn


def require_package(name: str, extra: str) -> None:
    """Ends with status 2 if a package is not installed.

    Args:
        name: of the package.
        extra: of ``locomotion``, which brings it.
    """
    if importlib.util.find_spec(name) is None:
        fail(f"hydra/launcher={extra} needs packages: pip install 'locomotion[{extra}]'", 2)


def fail(message: str, status: int = 1) -> NoReturn:
    """Ends with a line on standard error."""
    print(f"error: {message}", file=sys.stderr, flush=True)
    sys.exit(status)
