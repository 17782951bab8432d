"""All commands under one name: ``locomotion train robot=ant`` is ``python -m locomotion.train robot=ant``."""

from __future__ import annotations

import runpy
import sys

from locomotion.cli.refusal import refusing
from locomotion.options import ConfigError

_COMMANDS = {
    "train": "learns a gait",
    "evaluate": "measures how a policy walks",
    "robots": "lists the robots that can be chosen",
    "watch": "shows how a policy walks",
    "export": "takes a policy out of the simulator",
    "plot": "draws learning curves",
}


def main() -> None:
    """Runs the command that the first argument names, with the others."""
    with refusing():
        command = sys.argv[1] if len(sys.argv) > 1 else "without a command"
        if command in ("--help", "-h"):
            print("locomotion COMMAND ...\n")
            print(*(f"  {name:10}{meaning}" for name, meaning in _COMMANDS.items()), sep="\n")
            print("\nlocomotion COMMAND --help says what a command takes.")
            return
        if command not in _COMMANDS:
            known = ", ".join(_COMMANDS)
            raise ConfigError(f"locomotion {command} does nothing; choose from {known}")
    del sys.argv[1]
    runpy.run_module(f"locomotion.{command}", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
