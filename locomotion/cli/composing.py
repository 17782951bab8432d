"""A command line into the configuration and the folder of each of its jobs.

The jobs of a sweep are composed as Hydra itself will compose them, so that all of them are checked
before the first one runs, and Hydra's own part of the configuration before Hydra acts on it.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import hydra
import yaml
from hydra import version
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException, MissingConfigException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from locomotion.cli.fixed import refuse_what_is_fixed
from locomotion.cli.help import help_template
from locomotion.config import GROUPS, Config, typed_config
from locomotion.options import ConfigError, conf_dir, explain, import_plugins, learners
from locomotion.options.files import explain_yaml, read_yaml
from locomotion.physics.options import PhysicsConfig
from locomotion.robots import load_robot

#: Parts that there always are, so that adding one is choosing it.
_ADDED = ("obs", "plugins")


def compose(*overrides: str, config_dir: Path | str | None = None) -> Config:
    """The configuration that a command line stands for, such as ``compose("robot=ant")``.

    It can be used inside another Hydra application, which is left as it is.

    Raises:
        ConfigError: if it cannot be used.
    """
    with _hydra(), explained(overrides):
        place = None if config_dir is None else Path(config_dir)
        overrides = normalised(overrides, place)
        register(overrides)
        return typed_config(hydra.compose("config", overrides))


def normalised(overrides: Sequence[str], config_dir: Path | None = None) -> list[str]:
    """Overrides as Hydra takes them: without a plus where something is there already, with bodies from
    files as choices of their own, and with a folder of one's own in Hydra's search path.

    Raises:
        ConfigError: for what would quietly mean something else.
    """
    normal, places = [], [] if config_dir is None else [f"file://{config_dir.resolve()}"]
    for text in overrides:
        key, equals, value = text.partition("=")
        key = key[1:] if key.startswith("+") and key[1:] in _ADDED else key
        if key in GROUPS and value.startswith("["):
            raise ConfigError(f"{text} names several choices; {key} is one of them")
        if key.split(".")[0] == "robot" and "." in key and value.startswith("{"):
            raise ConfigError(
                f"{text} would be merged into another body; robot=FILE.yaml takes a file"
            )
        if key == "robot":
            value = ",".join(_robot_choice(part) for part in value.split(","))
        if key == "hydra.searchpath" and places:
            (override,) = OverridesParser.create().parse_overrides([text])
            places += [str(place) for place in override.value()]
        else:
            normal.append(f"{key}{equals}{value}")
    if places:
        quoted = (place.replace("\\", "\\\\").replace("'", "\\'") for place in places)
        normal.append("hydra.searchpath=[" + ",".join(f"'{place}'" for place in quoted) + "]")
    return normal


def _robot_choice(value: str) -> str:
    """The name of a robot; one that is a file becomes a choice of Hydra's."""
    path = Path(value.strip("'\""))
    if path.suffix not in (".yaml", ".yml"):
        return value
    known = {file.stem for file in (conf_dir() / "robot").glob("*.yaml")}
    name = "".join(letter if letter.isalnum() else "-" for letter in path.stem)
    name = f"{name}-file" if name in known else name
    node = dataclasses.asdict(load_robot(path))
    ConfigStore.instance().store(name, node=node, group="robot", package="robot")
    return name


def compose_job(overrides: Sequence[str], number: int | None = None) -> tuple[Config, Path]:
    """The configuration and the folder of a job.

    Args:
        overrides: those of the job, as :func:`normalised` returns them.
        number: its place in its sweep; ``None`` for a job by itself.

    Raises:
        ConfigError: if it cannot be used.
    """
    with _hydra(), explained(overrides):
        config = hydra.compose("config", list(overrides), return_hydra_config=True)
        refuse_what_is_fixed(config)
        return _job(config, number)


def _job(config: DictConfig, number: int | None) -> tuple[Config, Path]:
    instance, before = HydraConfig.instance(), HydraConfig.instance().cfg
    with open_dict(config):
        if number is not None:
            config.hydra.job.num = number
            config.hydra.job.id = f"{config.hydra.job.name}_{number}"
        instance.set_config(config)  # for what refers to ${hydra:...}
        try:
            if number is None:
                folder = Path(config.hydra.run.dir)
            else:
                folder = Path(config.hydra.sweep.dir, config.hydra.sweep.subdir)
            del config["hydra"]
            return typed_config(config), folder
        finally:
            instance.cfg = before


def split_sweep(overrides: Sequence[str], multirun: bool) -> list[list[str]] | None:
    """The overrides of each job of a sweep, as Hydra's sweeper finds them; ``None`` for no sweep.

    An experiment has lists of its own, which those on the command line replace, and may ask for a sweep.
    Another sweeper than Hydra's own finds its jobs as it goes; then there is one, of first values.

    Raises:
        ConfigError: for a list without a value.
    """
    with _hydra(), explained(overrides):
        given = _parsed(overrides)
        first = [_values(override)[0] for override in given]
        sweep = hydra.compose("config", first, return_hydra_config=True).hydra
        if not multirun and sweep.mode is not RunMode.MULTIRUN:
            for override in given:
                if override.is_sweep_override():
                    raise ConfigError(f"{override.input_line}: several values need --multirun")
            return None
        if sweep.runtime.choices["hydra/sweeper"] != "basic":
            return [first]
        lists = [f"{key}={values}" for key, values in (sweep.sweeper.params or {}).items()]
        values = {
            override.key_or_group: _values(override)
            for override in [*_parsed(normalised(lists)), *given]
        }
        return [list(job) for job in itertools.product(*values.values())]


def _parsed(overrides: Sequence[str]) -> list[Override]:
    loader = GlobalHydra.instance().config_loader()
    return OverridesParser.create(config_loader=loader).parse_overrides(list(overrides))


def _values(override: Override) -> list[str]:
    """An override, or each of those that a list of values stands for."""
    if not override.is_sweep_override():
        return [override.input_line]
    if not override.is_discrete_sweep():
        return [f"{override.get_key_element()}={override.value().start}"]  # of an interval
    key = override.get_key_element()
    values = [f"{key}={value}" for value in override.sweep_string_iterator()]
    if not values:
        raise ConfigError(f"{override.input_line} holds no value")
    return values


def parse(overrides: Sequence[str], where: str) -> list[Override]:
    """Overrides that each set one key to one value.

    Args:
        overrides: such as ``ppo.iterations=50``.
        where: where they stand, for messages.

    Raises:
        ConfigError: for anything else.
    """
    with explained(overrides):
        parsed = OverridesParser.create().parse_overrides(normalised(overrides))
    for override in parsed:
        hydras = override.key_or_group.startswith("hydra")
        if override.is_sweep_override() or override.is_delete() or hydras:
            raise ConfigError(f"{override.input_line} has no meaning {where}")
    return parsed


def amend(saved: DictConfig, overrides: Sequence[Override]) -> None:
    """Applies overrides to the configuration that a run was started with.

    ``physics=OPTION`` changes how the bodies are stepped, and leaves these as they were.

    Raises:
        ConfigError: for an option that is not there, or a key that cannot be set so.
    """
    for override in overrides:
        key, value = override.key_or_group, override.value()
        if key in GROUPS and isinstance(value, str):
            choices = sorted(file.stem for file in (conf_dir() / key).glob("*.yaml"))
            if value not in choices:
                raise ConfigError(f"{key}={value} is unknown; choose from {', '.join(choices)}")
            value = read_yaml(conf_dir() / key / f"{value}.yaml")
            if key == "physics":
                value = {**{name: None for name in PhysicsConfig.STEPPING}, **value}
        with explained([override.input_line]):
            OmegaConf.update(saved, key, value, merge=True, force_add=True)


def register(overrides: Sequence[str] = ()) -> None:
    """Tells Hydra the schema, the text of ``--help`` and what ``conf/`` computes.

    Args:
        overrides: whose plugins are imported first, as these may bring learners with keys of their own.
    """
    for override in OverridesParser.create().parse_overrides(list(overrides)):
        if override.key_or_group == "plugins" and isinstance(override.value(), list):
            import_plugins(map(str, override.value()))
    sections: list[Any] = []
    for name in learners.names():
        options = learners.get(name)
        sections.append((name, options, dataclasses.field(default_factory=options)))
    schema = dataclasses.make_dataclass("Schema", sections, bases=(Config,))
    store = ConfigStore.instance()
    store.store("schema", node=schema)
    store.store("locomotion", node={"template": help_template()}, group="hydra/help")
    OmegaConf.register_new_resolver("jobs_at_once", _jobs_at_once, replace=True)


@contextmanager
def _hydra() -> Iterator[None]:
    """Hydra with the project's configuration, and afterwards as it was."""
    register()
    others = version.getbase() if GlobalHydra.instance().is_initialized() else None
    try:
        with hydra.initialize_config_dir(str(conf_dir()), job_name="train", version_base="1.3"):
            yield
    finally:
        if others is not None:
            version.setbase(str(others))


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
        return explain(cause)
    message = " ".join(str(error).split())
    if isinstance(cause, OmegaConfBaseException):
        return f"{message.removeprefix('Error merging override ')}: {str(cause).splitlines()[0]}"
    return message
