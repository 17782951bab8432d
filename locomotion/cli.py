"""The command line that all entry points share: Hydra, with mistakes answered in one line.

The configuration of every job is composed and checked before Hydra starts any of them, so a typo in
the last job of a sweep is found before the first one runs.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
import typing
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import hydra
import yaml
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra._internal.utils import get_args_parser
from hydra.core.config_store import ConfigStore
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, MissingConfigException
from omegaconf import DictConfig
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from locomotion.config import (
    Config,
    ConfigError,
    conf_dir,
    explain_omegaconf,
    explain_yaml,
    typed,
)

_HELP = """Modular robots learn to walk.

  python -m locomotion.train                              the gecko, with the report's settings
  python -m locomotion.train robot=ant +obs=history3      another robot, other observations
  python -m locomotion.train --multirun robot=gecko,ant +obs=hinges,history3 seed=0,1
  python -m locomotion.train --config-dir=FOLDER robot=NAME     your body, FOLDER/robot/NAME.yaml

Parts, chosen by GROUP=OPTION (obs is added: +obs=OPTION)
$APP_CONFIG_GROUPS
Keys, set by KEY=VALUE
{keys}

Values now, with what else is on this command line
$CONFIG
Output goes to outputs/DATE/TIME, or multirun/DATE/TIME/JOB; hydra.run.dir=FOLDER changes that.
--cfg job prints the configuration alone, --hydra-help says what else Hydra can do.
"""


def launch(job: Callable[[Config, Path], None]) -> None:
    """Runs ``job(config, folder)`` with the configuration that the command line asks for.

    A configuration that cannot be used ends the process with one line on standard error and exit
    status 2.

    Args:
        job: called once for each job of a sweep, with the checked configuration and the folder for
            its output.
    """
    _register()
    arguments = get_args_parser().parse_args()
    if not (arguments.help or arguments.hydra_help or arguments.info or arguments.shell_completion):
        _check(arguments.overrides, arguments.config_dir, arguments.multirun)

    def run(config: DictConfig) -> None:
        try:
            job(typed(Config, config), Path(HydraConfig.get().runtime.output_dir))
        except ConfigError as error:
            _refuse(str(error))

    hydra.main(version_base="1.3", config_path=str(conf_dir()), config_name="config")(run)()


def compose(*overrides: str) -> Config:
    """The configuration that a command line stands for, such as ``compose("robot=ant")``.

    Raises:
        ConfigError: if it cannot be used.
    """
    _register()
    try:
        with hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
            return typed(Config, hydra.compose("config", list(overrides)))
    except (HydraException, OmegaConfBaseException, yaml.MarkedYAMLError) as error:
        raise ConfigError(_explain(error)) from error
    except ValueError as error:
        if isinstance(error, ConfigError):
            raise
        # Hydra's own, for a group that is set to a number; it does not say which.
        raise ConfigError(f"{error} in {' '.join(overrides)}") from error


@functools.cache
def _register() -> None:
    store = ConfigStore.instance()
    store.store("schema", node=Config)
    store.store("locomotion", node={"template": _help_template()}, group="hydra/help")


def _check(overrides: list[str], config_dir: str | None, multirun: bool) -> None:
    """Composes the configuration of every job and ends the process if one cannot be used."""
    try:
        if config_dir is not None and not Path(config_dir).is_dir():
            raise ConfigError(f"--config-dir={config_dir} is no folder")
        for job in _split(overrides) if multirun else [overrides]:
            if config_dir is not None:
                job = [*job, f"hydra.searchpath=[file://{Path(config_dir).resolve()}]"]
            compose(*job)
    except ConfigError as error:
        _refuse(str(error))


def _split(overrides: list[str]) -> list[list[str]]:
    """The overrides of each job of a sweep."""
    try:
        parsed = OverridesParser.create().parse_overrides(overrides)
    except HydraException as error:
        raise ConfigError(_explain(error)) from error
    return BasicSweeper.split_arguments(parsed, max_batch_size=None)[0]


def _explain(error: Exception) -> str:
    if isinstance(error, MissingConfigException) and error.options is not None:
        group, _, option = error.missing_cfg_file.rpartition("/")
        return f"{group}={option} is unknown; choose from {', '.join(error.options)}"
    if isinstance(error, yaml.MarkedYAMLError):
        return explain_yaml(error)
    cause = error.__cause__ or error.__context__
    if isinstance(cause, (ConfigAttributeError, ConfigKeyError)):
        return explain_omegaconf(cause)
    message = " ".join(str(error).split())
    if message.startswith("Ambiguous value for argument"):
        return f"{message.split(chr(39))[1]}: several values need --multirun"
    if isinstance(cause, OmegaConfBaseException):
        return f"{message.removeprefix('Error merging override ')}: {str(cause).splitlines()[0]}"
    return message


def _help_template() -> str:
    """The text of ``--help``: groups and the configuration are filled in by Hydra, keys by us."""
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


def _refuse(message: str) -> NoReturn:
    print(f"error: {message}", file=sys.stderr)
    sys.exit(2)
