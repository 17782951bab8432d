"""Arguments that the benchmarks' commands have in common."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any, NoReturn


class Parser(argparse.ArgumentParser):
    """A command line with ``--quick`` and ``--json FILE``, whose mistakes are answered in one line.

    Args:
        module: what is run with ``python -m``.
        description: what it does.
        quick: what ``--quick`` does.
    """

    def __init__(self, module: str, description: str, quick: str) -> None:
        super().__init__(prog=f"python -m {module}", description=description)
        self.add_argument("--quick", action="store_true", help=f"{quick}, only to see that it runs")
        self.add_argument("--json", type=Path, metavar="FILE", help="write the results there too")

    def parse_args(self, *passed: Any) -> argparse.Namespace:
        """The arguments; a file for results that cannot be written is found out before it is needed."""
        arguments = super().parse_args(*passed)
        for name, value in vars(arguments).items():
            if name in ("json", "plot") and value is not None:
                try:
                    value.touch()
                except OSError as error:
                    self.error(f"--{name} {value}: {error.strerror}")
        return arguments

    def error(self, message: str) -> NoReturn:
        print(f"error: {message}", file=sys.stderr)
        sys.exit(2)
