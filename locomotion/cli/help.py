"""The text of ``python -m locomotion.train --help``."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

from locomotion.config import Config, described
from locomotion.envs.observations import ObsTerm
from locomotion.options import learners, networks, readings, rewards

_HELP = """Modular robots learn to walk.

  python -m locomotion.train                              the gecko, with the report's settings
  python -m locomotion.train +experiment=quick            a gait in about a minute
  python -m locomotion.train robot=ant +obs=history3      another robot, other observations
  python -m locomotion.train --multirun robot=gecko,ant +obs=hinges,history3 seed=0,1
  python -m locomotion.train --multirun +experiment=ablation    every run of Figures 2 and 3
  python -m locomotion.train robot=mine.yaml              your body, from a file
  python -m locomotion.train --config-dir=FOLDER +obs=mine      your choice, FOLDER/obs/mine.yaml
  python -m locomotion.train +plugins=[my_gaits] network=mine   what your module registers
  python -m locomotion.train resume=FOLDER                resume a run that was interrupted

Parts, chosen by GROUP=OPTION (experiment is added: +experiment=OPTION)
$APP_CONFIG_GROUPS
Keys, set by KEY=VALUE, with their range and [default]
{keys}

Readings, which obs.TERM can name
{readings}

Rewards, for task.rewards
{rewards}

Values now, with what else is on this command line
$CONFIG
Output goes to outputs/DATE/TIME, or multirun/DATE/TIME/JOB; hydra.run.dir=FOLDER changes that. A
folder with the finished run of the same configuration is left as it is, one with another refused.
--cfg job prints the configuration alone, --hydra-help says what else Hydra can do.
"""


def help_template() -> str:
    """Groups and the configuration are filled in by Hydra, keys here."""
    fields = list(described(Config))
    for name in learners.names():
        fields += described(learners.get(name), f"{name}.")
    for name in networks.names():
        own = described(networks.get(name), "network.")
        fields += [pair for pair in own if pair[0] not in dict(fields)]
    fields += described(ObsTerm, "obs.TERM.")
    known = ((name, readings.get(name)) for name in readings.names())
    return _HELP.format(
        keys=listed((name, summary(field)) for name, field in fields if field.metadata),
        readings=listed(
            (name, f"{reading.meaning}{f' ({reading.unit})' if reading.unit else ''}")
            for name, reading in known
        ),
        rewards=listed((name, first_line(rewards.get(name))) for name in rewards.names()),
    ).replace("$$", "$")


def summary(field: dataclasses.Field) -> str:
    """Meaning, range and default of an option, in a line."""
    words = (("above", "above"), ("least", "at least"), ("most", "at most"))
    limits = [
        f"{word} {field.metadata[name]:g}"
        for name, word in words
        if field.metadata.get(name) is not None
    ]
    default = field.default
    if field.default_factory is not dataclasses.MISSING:
        default = field.default_factory()
    shown = getattr(default, "name", default)
    shown = "null" if shown is None else str(shown).lower() if isinstance(shown, bool) else shown
    text = field.metadata["meaning"] + (f"; {', '.join(limits)}" if limits else "")
    return text if shown == "???" else f"{text} [{shown}]"


def listed(rows: Iterable[tuple[str, str]]) -> str:
    """Rows of two columns."""
    rows = list(rows)
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"  {name:{width}}  {text}" for name, text in rows)


def first_line(choice: object) -> str:
    """The summary of a class's docstring."""
    return (getattr(choice, "__doc__", None) or "").strip().splitlines()[0].rstrip(".")
