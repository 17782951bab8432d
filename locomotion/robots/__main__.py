"""Lists and draws the bodies that can be chosen: ``python -m locomotion.robots``."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np

from locomotion.cli.composing import parse
from locomotion.cli.help import listed
from locomotion.cli.refusal import refusing
from locomotion.evaluation.shipped import shipped
from locomotion.options import (
    Checked,
    ConfigError,
    choices,
    described,
    key,
    read_choice,
    summary,
    typed,
)
from locomotion.robots.body import Module, RobotConfig, load_robot, parse_body, placed_boxes
from locomotion.robots.files import read_revolve2, save_robot

_HELP = """Lists robots, and draws them from above.

  python -m locomotion.robots                    all that can be chosen, and robots.png
  python -m locomotion.robots robot=mine.yaml    a body of one's own, before it is trained
  python -m locomotion.robots robot=random robot.seed=7 save=seven.yaml    a body that is drawn
  python -m locomotion.robots robot=theirs.json save=theirs.yaml    a body of Revolve2 becomes a file of its own

Keys of this command, set by KEY=VALUE, with their range and [default]
{keys}

Mass is in kg; length, width and height are those of a robot that stands with all hinges at 0, in cm. Where a
policy ships, python -m locomotion.watch robot=NAME shows it."""


@dataclasses.dataclass
class RobotsConfig(Checked):
    """``python -m locomotion.robots``."""

    robot: str | None = key(
        "one robot, FILE.yaml, or FILE.json of Revolve2; null: all that can be chosen", default=None
    )
    save: str | None = key("YAML file to write the one robot to", default=None)
    output: str | None = key("picture to write; null: none", default="robots.png")


def row(name: str, body: Module) -> list[str]:
    """One robot of the table: name, hinges, bricks, mass (kg), size (cm), and whether a policy ships."""
    kinds = [module.kind for module in body.walk()]
    boxes = [*placed_boxes(body)]
    mass = sum(box.mass for _, box, _, _ in boxes)
    low = np.min([centre - lengths / 2 for _, _, centre, lengths in boxes], axis=0)
    high = np.max([centre + lengths / 2 for _, _, centre, lengths in boxes], axis=0)
    size = " x ".join(f"{100 * length:.0f}" for length in high - low)
    counts = [str(kinds.count(kind)) for kind in ("hinge", "brick")]
    return [name, *counts, f"{mass:.2f}", size, "yes" if name in shipped() else ""]


def table(found: dict[str, Module]) -> str:
    """All robots, a line each."""
    head = ["robot", "hinges", "bricks", "kg", "cm", "policy ships"]
    rows = [head, *(row(name, body) for name, body in found.items())]
    widths = [max(len(cells[column]) for cells in rows) for column in range(len(head))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()
        for cells in rows
    )


def _configs(options: RobotsConfig, own: dict[str, Any]) -> list[RobotConfig]:
    if options.robot is None:
        if own:
            raise ConfigError(f"robot.{next(iter(own))} needs robot=NAME, such as robot=random")
        if options.save is not None:
            options.refuse("save", options.save, "null unless robot names one")
        return [load_robot(robot) for robot in choices("robot")]
    if options.robot.endswith(".json"):
        return [read_revolve2(options.robot)]
    if own:
        return [typed(RobotConfig, read_choice("robot", options.robot), own)]
    return [load_robot(options.robot)]


def main() -> None:
    """Does what the command line asks for."""
    with refusing():
        arguments = sys.argv[1:]
        if {"--help", "-h"} & {*arguments}:
            print(_HELP.format(keys=listed((n, summary(f)) for n, f in described(RobotsConfig))))
            return
        given, own = _given(arguments)
        options = typed(RobotsConfig, given)
        configs = _configs(options, own)
        if options.save is not None:
            save_robot(configs[0], options.save)
        found = {config.name: parse_body(config.body) for config in configs}
        print(table(found))
        if options.output is not None:
            from locomotion.plots.bodies import bodies
            from locomotion.plots.figures import save

            save(bodies(found), Path(options.output))
            print(f"\n{options.output} shows them from above")


def _given(arguments: list[str]) -> tuple[dict[str, str | None], dict[str, Any]]:
    """The keys of this command, and those of the one robot."""
    known = {field.name for field in dataclasses.fields(RobotsConfig)}
    given, own = {}, {}
    for override in parse(arguments, "for a list of robots"):
        name, value = override.key_or_group, override.value()
        if name.startswith("robot."):
            own[name.removeprefix("robot.")] = value
        elif name in known:
            given[name] = None if value is None else str(value)
        else:
            allowed = ", ".join([*sorted(known), "robot.seed"])
            raise ConfigError(f"{name} is not a key; allowed are {allowed}")
    return given, own


if __name__ == "__main__":
    main()
