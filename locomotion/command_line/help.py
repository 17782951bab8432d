"""The text of ``python -m locomotion.train --help``."""

from __future__ import annotations

import dataclasses
import typing

from locomotion.config import Config

_HELP = """Modular robots learn to walk.

  python -m locomotion.train                              the gecko, with the report's settings
  python -m locomotion.train +experiment=quick            a gait in little more than a minute
  python -m locomotion.train robot=ant +obs=history3      another robot, other observations
  python -m locomotion.train --multirun robot=gecko,ant +obs=hinges,history3 seed=0,1
  python -m locomotion.train --multirun +experiment=ablation    every run of Figures 2 and 3
  python -m locomotion.train --config-dir=FOLDER robot=NAME     your body, FOLDER/robot/NAME.yaml
  python -m locomotion.train resume=FOLDER                go on with a run that was interrupted

Parts, chosen by GROUP=OPTION (obs and experiment are added: +obs=OPTION)
$APP_CONFIG_GROUPS
Keys, set by KEY=VALUE
{keys}

Values now, with what else is on this command line
$CONFIG
Output goes to outputs/DATE/TIME, or multirun/DATE/TIME/JOB; hydra.run.dir=FOLDER changes that. A
folder with the finished run of the same configuration is left as it is, one with another refused.
--cfg job prints the configuration alone, --hydra-help says what else Hydra can do.
"""


def help_template() -> str:
    """Groups and the configuration are filled in by Hydra, keys here."""
    keys = []
    for group, schema in typing.get_type_hints(Config).items():
        fields = dataclasses.fields(schema) if dataclasses.is_dataclass(schema) else ()
        keys += [(f"{group}.{field.name}", field.metadata["meaning"]) for field in fields]
    keys += [
        (field.name, field.metadata["meaning"])
        for field in dataclasses.fields(Config)
        if "meaning" in field.metadata
    ]
    width = max(len(key) for key, _ in keys)
    return _HELP.format(keys="\n".join(f"  {key:{width}}  {meaning}" for key, meaning in keys))
