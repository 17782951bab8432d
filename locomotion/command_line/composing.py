"""What a command line stands for: the configuration and the folder of each of its jobs.

The jobs of a sweep are composed here as Hydra itself will compose them, so that all of them can be
checked before the first one runs, and Hydra's own part of the configuration before Hydra sees it.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import hydra
import yaml
from hydra import version
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra._internal.hydra import Hydra
from hydra._internal.utils import create_config_search_path
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException, MissingConfigException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from locomotion.command_line.help import help_template
from locomotion.config import (
    GROUPS,
    Config,
    ConfigError,
    PhysicsConfig,
    conf_dir,
    explain_omegaconf,
    explain_yaml,
    flat,
    load,
    typed,
)

#: What of Hydra's own part may be set. The rest names what Hydra calls, what logging opens and what a
#: process is told by its environment, and a configuration may come from a stranger.
_SETTABLE = (
    "job.config",
    "job.config_name",
    "job.id",
    "job.name",
    "job.num",
    "job.override_dirname",
    "job.sweep",
    "launcher.n_jobs",
    "mode",
    "overrides",
    "run.dir",
    "runtime",
    "searchpath",
    "sweep.dir",
    "sweep.subdir",
    "sweeper.params",
)


def compose(*overrides: str) -> Config:
    """The configuration that a command line stands for, such as ``compose("robot=ant")``.

    Raises:
        ConfigError: if it cannot be used.
    """
    return compose_job(overrides)[0]


def compose_job(
    overrides: Sequence[str], number: int | None = None, config_dir: Path | None = None
) -> tuple[Config, Path]:
    """The configuration and the folder of a job.

    Args:
        overrides: those of the job.
        number: its place in its sweep; ``None`` for a job by itself.
        config_dir: where else to look for choices.

    Raises:
        ConfigError: if it cannot be used.
    """
    with _hydra(config_dir), explained(overrides):
        config = hydra.compose("config", list(overrides), return_hydra_config=True)
        _refuse_what_is_fixed(config)
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


def split_sweep(
    overrides: Sequence[str], multirun: bool, config_dir: Path | None = None
) -> list[list[str]] | None:
    """The overrides of each job of a sweep, as Hydra's sweeper finds them; ``None`` for no sweep.

    An experiment has lists of its own, which those on the command line replace, and may ask for a sweep.

    Raises:
        ConfigError: if there is none such.
    """
    with _hydra(config_dir), explained(overrides):
        loader = GlobalHydra.instance().config_loader()
        sweep = loader.load_configuration("config", list(overrides), RunMode.MULTIRUN).hydra
        if not multirun and sweep.mode is not RunMode.MULTIRUN:
            return None
        lists = [f"{key}={values}" for key, values in (sweep.sweeper.params or {}).items()]
        parsed = OverridesParser.create().parse_overrides([*lists, *overrides])
        return BasicSweeper.split_arguments(parsed, max_batch_size=None)[0]


def parse(overrides: Sequence[str], where: str) -> list[Override]:
    """Overrides that each set one key to one value.

    Args:
        overrides: such as ``ppo.iterations=50``.
        where: where they stand, for messages.

    Raises:
        ConfigError: for anything else.
    """
    with explained(overrides):
        parsed = OverridesParser.create().parse_overrides(list(overrides))
    for override in parsed:
        hydras = override.key_or_group.startswith("hydra")
        if override.is_sweep_override() or override.is_delete() or hydras:
            raise ConfigError(f"{override.input_line} has no meaning {where}")
    return parsed


def amend(saved: DictConfig, overrides: Sequence[Override]) -> None:
    """Applies overrides to the configuration that a run was started with.

    ``physics=OPTION`` changes what steps the bodies, and leaves these as they were.

    Raises:
        ConfigError: for an option that is not there, or a key that cannot be set so.
    """
    for override in overrides:
        key, value = override.key_or_group, override.value()
        if key in GROUPS and isinstance(value, str):
            value = dataclasses.asdict(load(f"{key}/{value}"))
            if key == "physics":
                value = {name: value[name] for name in PhysicsConfig.STEPPING}
        with explained([override.input_line]):
            OmegaConf.update(saved, key, value, merge=True, force_add=True)


@functools.cache
def register() -> None:
    """Tells Hydra the schema, the text of ``--help`` and what ``conf/`` computes."""
    store = ConfigStore.instance()
    store.store("schema", node=Config)
    store.store("locomotion", node={"template": help_template()}, group="hydra/help")
    OmegaConf.register_new_resolver("jobs_at_once", _jobs_at_once)


@contextmanager
def _hydra(config_dir: Path | None = None) -> Iterator[None]:
    """Hydra as ``--config-dir`` would set it up."""
    register()
    version.setbase("1.3")
    places = create_config_search_path(str(conf_dir()))
    if config_dir is not None:
        places.prepend("command-line", f"file://{config_dir.resolve()}", anchor="schema")
    GlobalHydra.instance().clear()
    Hydra.create_main_hydra2("train", places)
    try:
        yield
    finally:
        GlobalHydra.instance().clear()


def _refuse_what_is_fixed(config: DictConfig) -> None:
    """Raises a :class:`ConfigError` if Hydra's own part is set to what only the project may set."""
    launcher = config.hydra.launcher.get("_target_")
    for choice in ("basic", "parallel"):
        fixed = _fixed(choice)
        if fixed["launcher._target_"] == launcher:
            break
    else:
        raise ConfigError(
            f"hydra.launcher._target_={launcher} is fixed; use hydra/launcher=parallel"
        )
    asked = _as_written(config)
    for key in [*asked, *(fixed.keys() - asked.keys())]:
        settable = any(key == name or key.startswith(f"{name}.") for name in _SETTABLE)
        if not settable and asked.get(key) != fixed.get(key):
            raise ConfigError(f"hydra.{key}={asked.get(key)} is fixed; it stays {fixed.get(key)}")


@functools.cache
def _fixed(launcher: str) -> dict[str, Any]:
    """Hydra's part of the project's own configuration, with one of its launchers."""
    overrides = [f"hydra/launcher={launcher}"]
    return _as_written(hydra.compose("config", overrides, return_hydra_config=True))


def _as_written(config: DictConfig) -> dict[str, Any]:
    """Hydra's part of a configuration by key, with what refers to something else as it was written."""
    return dict(flat(OmegaConf.to_container(config.hydra, resolve=False)))


@contextmanager
def explained(overrides: Sequence[str]) -> Iterator[None]:
    """Turns what Hydra raises about a command line into a :class:`ConfigError`."""
    try:
        yield
    except (HydraException, OmegaConfBaseException, yaml.YAMLError) as error:
        raise ConfigError(_explain(error)) from error
    except RecursionError as error:
        raise ConfigError("the configuration is nested too deeply") from error
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
    if isinstance(error, yaml.YAMLError):
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
