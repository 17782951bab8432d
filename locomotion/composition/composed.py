"""One configuration, composed by Hydra and checked for what Hydra would do with it."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

import hydra
from omegaconf import DictConfig

from locomotion.composition.application import application
from locomotion.composition.fixed import refuse_what_is_fixed
from locomotion.options import ConfigError
from locomotion.robots import refuse_sexagesimal

#: Where Hydra finds files that are its own or the project's.
_OWN_SOURCES = ("hydra", "main", "schema")


def composed(overrides: Sequence[str]) -> DictConfig:
    """The configuration that overrides stand for, Hydra's own part included.

    It is called within :func:`~locomotion.composition.application.application`.

    Raises:
        ConfigError: for what a stranger's configuration may not set, or a body not from a file.
    """
    config = hydra.compose("config", list(overrides), return_hydra_config=True)
    # Files of the project's own set nothing that is fixed, and no body but a robot's.
    trusted = all(source.provider in _OWN_SOURCES for source in config.hydra.runtime.config_sources)
    if not trusted or any(line.lstrip("+~").startswith("hydra") for line in overrides):
        refuse_what_is_fixed(config, _own)
    if "robot" not in config.hydra.runtime.choices:
        raise ConfigError("robot is missing; give it the name of a choice, or a FILE.yaml")
    for source in config.hydra.runtime.config_sources:
        file = Path(source.path, "robot", f"{config.hydra.runtime.choices.robot}.yaml")
        if source.schema == "file" and file.is_file():
            refuse_sexagesimal(file)
    if not trusted:
        _refuse_merged_body(config, overrides)
    return config


@functools.cache
def _own(launcher: str, sweeper: str) -> DictConfig:
    with application(None):  # nobody's folder is searched
        choices = [f"hydra/launcher={launcher}", f"hydra/sweeper={sweeper}"]
        return hydra.compose("config", choices, return_hydra_config=True)


def _refuse_merged_body(config: DictConfig, overrides: Sequence[str]) -> None:
    """Raises a :class:`ConfigError` if a file that is not the robot's own has put modules into its body.

    YAML files are merged, so a body in an experiment would become half another one.
    """
    keys = {line.partition("=")[0].lstrip("+") for line in overrides}
    if not {key for key in keys if "." not in key} - {"robot"}:
        return  # no other file was chosen
    robot = config.hydra.runtime.choices.robot
    search = ("robot.", "+robot.", "++robot.", "~robot.", "hydra.searchpath")
    alone = [f"robot={robot}", *(line for line in overrides if line.startswith(search))]
    if config.robot.get("body") != hydra.compose("config", alone).robot.get("body"):
        raise ConfigError(
            f"robot.body of another file would be merged into that of robot={robot}; a body of your"
            " own is a FILE.yaml, chosen by robot=FILE.yaml"
        )
