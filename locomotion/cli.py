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
import tempfile
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

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
    load,
    typed,
)
from locomotion.runs import (
    RunError,
    RunStopped,
    differences,
    is_finished,
    read_config,
    record,
)

_HELP = """Modular robots learn to walk.

  python -m locomotion.train                              the gecko, with the report's settings
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
    if arguments.experimental_rerun is not None:
        _refuse("--experimental-rerun runs what is in a file; use resume=FOLDER")
    # A launcher that runs jobs side by side takes them along when it is interrupted, not when killed.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        folder, overrides = _resumed(arguments.overrides)
        if folder is not None:
            _resume(job, folder, overrides, arguments.multirun)
            return
        informs = (arguments.help, arguments.hydra_help, arguments.info, arguments.shell_completion)
        if not any(informs):
            _check(arguments)

        def run(config: DictConfig) -> None:
            details = HydraConfig.get()
            folder = Path(details.runtime.output_dir)
            overrides = details.overrides.task
            files = {"config": config, "hydra": {"hydra": details}, "overrides": overrides}
            _run(job, typed(Config, config), folder, files)

        hydra.main(version_base="1.3", config_path=str(conf_dir()), config_name="config")(run)()
    except (ConfigError, RunError) as error:
        _refuse(str(error))
    except KeyboardInterrupt as error:
        print(str(error) or "interrupted", file=sys.stderr)
        sys.exit(130)


def _run(
    job: Callable[[Config, Path], None], config: Config, folder: Path, files: Mapping[str, Any]
) -> None:
    """Runs a job unless that was done before; ``files`` is what to record of it."""
    try:
        if is_finished(folder, config):
            print(f"{folder}: finished before, skipped", flush=True)
            return
        record(folder, **files)
        job(config, folder)
    except (ConfigError, RunError) as error:
        _refuse(str(error))
    except RunStopped as error:
        _refuse(str(error), status=1)
    except OSError as error:
        _refuse(f"{error.filename or folder}: {error.strerror or error}", status=1)
    except (MemoryError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "can't allocate memory" not in str(error):
            raise
        _refuse(
            f"not enough memory for env.num_envs={config.env.num_envs} robots that take"
            f" ppo.steps={config.ppo.steps} each",
            status=1,
        )


def _resumed(overrides: list[str]) -> tuple[Path | None, list[str]]:
    """The folder that ``resume=FOLDER`` names, if it is there, and the other overrides."""
    folders = [text.partition("=")[2] for text in overrides if text.startswith("resume=")]
    others = [text for text in overrides if not text.startswith("resume=")]
    if len(folders) > 1:
        raise ConfigError("resume names several folders; a command goes on with one run")
    return (Path(folders[0]) if folders else None), others


def _resume(
    job: Callable[[Config, Path], None], folder: Path, overrides: list[str], multirun: bool
) -> None:
    """Goes on with the run in a folder, in which only what leaves its numbers alone may change."""
    if multirun:
        raise ConfigError("resume=FOLDER goes on with one run; a sweep goes on when started again")
    unchanged = read_config(folder)
    saved = OmegaConf.create(unchanged)
    before = typed(Config, saved).ppo.iterations
    with _explained(overrides):
        parsed = OverridesParser.create().parse_overrides(overrides)
    for override in parsed:
        key, value = override.key_or_group, override.value()
        if override.is_sweep_override() or override.is_delete() or key.startswith("hydra"):
            raise ConfigError(f"{override.input_line} has no meaning beside resume=FOLDER")
        if key in {field.name for field in dataclasses.fields(Config)} and isinstance(value, str):
            value = OmegaConf.structured(load(f"{key}/{value}"))
        OmegaConf.update(saved, key, value, merge=True, force_add=True)
    config = typed(Config, saved)
    for key, (there, asked) in differences(folder, config).items():
        if key != "ppo.iterations":
            raise ConfigError(f"{asked} would change the run in {folder}, which has {there}")
    if config.ppo.iterations < before:
        raise ConfigError(
            f"ppo.iterations={config.ppo.iterations} must be at least the {before} of the run"
        )
    _require_writable(folder)
    record(folder, config=saved)
    _run(job, config, folder, {})


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
            _refuse_code(OmegaConf.to_container(config.hydra, resolve=False), "hydra")
            del config["hydra"]
        return typed(Config, config), folder


def _refuse_code(content: Any, place: str) -> None:
    """Raises a :class:`ConfigError` if Hydra's part of a configuration names code that is not Hydra's.

    Hydra calls what ``_target_`` names, Python's logging what ``()`` and ``class`` name, and a process
    is told by its environment what to load. A configuration may come from a stranger.
    """
    if isinstance(content, list):
        content = dict(enumerate(content))
    for key, value in content.items() if isinstance(content, dict) else ():
        allowed = {
            "_target_": ("hydra._internal.core_plugins.", "hydra_plugins."),
            "class": ("logging.",),
            "()": (),
            "env_set": (),
        }.get(key)
        if allowed is not None and value and not str(value).startswith(allowed):
            from_where = ", ".join(f"{start}*" for start in allowed) or "nothing"
            raise ConfigError(
                f"{place}.{key}={value} is not run from a configuration: {from_where} is"
            )
        _refuse_code(value, f"{place}.{key}")


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
                _require_writable(folder)
    except (ConfigError, RunError) as error:
        _refuse(str(error))


def _require_writable(folder: Path) -> None:
    """Raises a :class:`RunError` if nothing can be written to a folder, which need not exist yet."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise RunError(f"{folder} cannot be written: {error.strerror}") from error


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


def _refuse(message: str, status: int = 2) -> NoReturn:
    print(f"error: {message}", file=sys.stderr)
    sys.exit(status)
