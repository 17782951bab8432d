"""The command line that all entry points share: Hydra, with mistakes answered in one line.

The configuration of every job is composed and checked before Hydra starts any of them, so a typo in
the last job of a sweep is found before the first one runs.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import signal
import sys
import typing
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import hydra
import yaml
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra._internal.utils import get_args_parser
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, MissingConfigException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from locomotion.config import (
    Config,
    ConfigError,
    conf_dir,
    explain_omegaconf,
    explain_yaml,
    typed,
)
from locomotion.runs import RunError, is_finished, record

_HELP = """Modular robots learn to walk.

  python -m locomotion.train                              the gecko, with the report's settings
  python -m locomotion.train robot=ant +obs=history3      another robot, other observations
  python -m locomotion.train --multirun robot=gecko,ant +obs=hinges,history3 seed=0,1
  python -m locomotion.train --multirun +experiment=ablation    every run of Figures 2 and 3
  python -m locomotion.train --config-dir=FOLDER robot=NAME     your body, FOLDER/robot/NAME.yaml

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
        _check(arguments)

    def run(config: DictConfig) -> None:
        details = HydraConfig.get()
        folder = Path(details.runtime.output_dir)
        try:
            checked = typed(Config, config)
            if is_finished(folder, checked):
                print(f"{folder}: finished before, skipped", flush=True)
                return
            record(
                folder, config=config, hydra={"hydra": details}, overrides=details.overrides.task
            )
            job(checked, folder)
        except (ConfigError, RunError) as error:
            _refuse(str(error))

    # A launcher that runs jobs side by side takes them along when it is interrupted, not when killed.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        hydra.main(version_base="1.3", config_path=str(conf_dir()), config_name="config")(run)()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)


def compose(*overrides: str) -> Config:
    """The configuration that a command line stands for, such as ``compose("robot=ant")``.

    Raises:
        ConfigError: if it cannot be used.
    """
    return _compose(overrides)[0]


def _compose(overrides: Sequence[str], number: int | None = None) -> tuple[Config, Path]:
    """The configuration and the folder of a job, of which ``number`` is the place in its sweep."""
    _register()
    with _explained(overrides), hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        config = hydra.compose("config", list(overrides), return_hydra_config=True)
        with open_dict(config):
            if number is not None:
                config.hydra.job.num = number
                config.hydra.job.id = f"{config.hydra.job.name}_{number}"
            HydraConfig.instance().set_config(config)  # for what refers to ${hydra:...}
            if number is None:
                folder = Path(config.hydra.run.dir)
            else:
                folder = Path(config.hydra.sweep.dir, config.hydra.sweep.subdir)
            del config["hydra"]
        return typed(Config, config), folder


@functools.cache
def _register() -> None:
    store = ConfigStore.instance()
    store.store("schema", node=Config)
    store.store("locomotion", node={"template": _help_template()}, group="hydra/help")
    OmegaConf.register_new_resolver("jobs_at_once", _jobs_at_once)


def _check(arguments: argparse.Namespace) -> None:
    """Composes the configuration of every job and ends the process if one cannot be used.

    Looks at the jobs' folders too, unless the command line asks for the configuration alone.
    """
    try:
        overrides = arguments.overrides
        if arguments.config_dir is not None:
            if not Path(arguments.config_dir).is_dir():
                raise ConfigError(f"--config-dir={arguments.config_dir} is no folder")
            place = Path(arguments.config_dir).resolve()
            overrides = [*overrides, f"hydra.searchpath=[file://{place}]"]
        jobs = _split(overrides, arguments.multirun)
        taken = set()
        for number, job in enumerate(jobs or [overrides]):
            config, folder = _compose(job, None if jobs is None else number)
            if folder in taken:
                raise ConfigError(
                    f"two jobs would write to {folder}; hydra.sweep.subdir tells jobs apart"
                )
            taken.add(folder)
            if not arguments.cfg:
                is_finished(folder, config)
    except (ConfigError, RunError) as error:
        _refuse(str(error))


def _split(overrides: list[str], multirun: bool) -> list[list[str]] | None:
    """The overrides of each job of a sweep, as Hydra's sweeper finds them; ``None`` for no sweep.

    An experiment has lists of its own, which those on the command line replace, and may ask for a sweep.
    """
    with _explained(overrides), hydra.initialize_config_dir(str(conf_dir()), version_base="1.3"):
        loader = GlobalHydra.instance().config_loader()
        sweep = loader.load_configuration("config", overrides, RunMode.MULTIRUN).hydra
        if not multirun and sweep.mode is not RunMode.MULTIRUN:
            return None
        lists = [f"{key}={values}" for key, values in (sweep.sweeper.params or {}).items()]
        parsed = OverridesParser.create().parse_overrides([*lists, *overrides])
        return BasicSweeper.split_arguments(parsed, max_batch_size=None)[0]


@contextmanager
def _explained(overrides: Sequence[str]) -> Iterator[None]:
    """Turns what Hydra raises about a command line into a :class:`ConfigError`."""
    try:
        yield
    except (HydraException, OmegaConfBaseException, yaml.MarkedYAMLError) as error:
        raise ConfigError(_explain(error)) from error
    except ValueError as error:
        if isinstance(error, ConfigError):
            raise
        # Hydra's own, for a group that is set to a number; it does not say which.
        raise ConfigError(f"{error} in {' '.join(overrides)}") from error


def _jobs_at_once(threads: int | None) -> int:
    """How many jobs of a sweep the usable cores have room for, each with so many threads."""
    from joblib import cpu_count  # knows of affinity and of a container's share

    return max(1, cpu_count() // (threads or cpu_count()))


def _explain(error: Exception) -> str:
    if getattr(error, "missing_cfg_file", None) == "hydra/launcher/joblib":
        return "jobs side by side need a package: pip install hydra-joblib-launcher"
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
