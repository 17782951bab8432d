"""A command line into the configuration and the folder of each of its jobs.

The jobs of a sweep are composed as Hydra itself will compose them, so that all of them are checked
before the first one runs, and Hydra's own part of the configuration before Hydra acts on it.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import hydra
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.core.plugins import Plugins
from hydra.core.utils import JobRuntime
from hydra.plugins.search_path_plugin import SearchPathPlugin
from hydra.types import RunMode
from hydra.version import VersionBase
from omegaconf import DictConfig, OmegaConf, open_dict

from locomotion.cli.fixed import refuse_what_is_fixed
from locomotion.cli.help import table
from locomotion.cli.refusal import explained
from locomotion.config import GROUPS, Config, typed_config
from locomotion.options import ConfigError, conf_dir, import_plugins, learners, read_choice
from locomotion.robots import load_robot
from locomotion.tasks.options import TaskConfig

Job = tuple[Config, Path]
#: A YAML file in a value, in quotes or up to what separates values.
_FILE = re.compile(r"""'[^']+\.ya?ml'|"[^"]+\.ya?ml"|[^,()'"]+\.ya?ml(?=[,)]|$)""")


def compose(*overrides: str, config_dir: Path | str | None = None) -> Config:
    """See :func:`locomotion.compose`; another Hydra application around it is left as it is."""
    given = normalised(overrides)
    register(given)
    with _hydra(config_dir), explained():
        return typed_config(hydra.compose("config", given))


def compose_jobs(
    overrides: Sequence[str], multirun: bool = False, config_dir: Path | str | None = None
) -> list[Job]:
    """The configuration and the folder of each job, as Hydra will compose them.

    An experiment has lists of its own, which those on the command line replace, and may ask for a sweep.
    Another sweeper than Hydra's own finds its jobs as it goes; then there is one, of first values.

    Args:
        overrides: those of the command line, as :func:`normalised` returns them.
        multirun: whether it asks for a sweep.
        config_dir: a folder with choices of one's own.

    Raises:
        ConfigError: if one of the jobs cannot be used.
    """
    register(overrides)
    with _hydra(config_dir), explained():
        parser = OverridesParser.create(config_loader=GlobalHydra.instance().config_loader())
        given = parser.parse_overrides(list(overrides))
        swept = [override.input_line for override in given if override.is_sweep_override()]
        single = [line for line in overrides if line not in swept]
        common = _composed(single)
        if not multirun and common.hydra.mode is not RunMode.MULTIRUN:
            if swept:
                raise ConfigError(f"{swept[0]}: several values need --multirun")
            return [_job(common)]
        own = common.hydra.runtime.choices["hydra/sweeper"] == "basic"
        params = common.hydra.sweeper.get("params") or {}
        lists = [f"{key}={values}" for key, values in params.items()]
        values = {
            override.get_key_element(): _values(override, own)
            for override in [*parser.parse_overrides(lists), *given]
        }
        jobs = itertools.islice(itertools.product(*values.values()), None if own else 1)
        HydraConfig.instance().set_config(common)
        str(common.hydra.sweep.dir)  # the time in it is that of all jobs
        return [_job(_composed(job), number, common) for number, job in enumerate(jobs)]


def _values(override: Override, enumerated: bool) -> list[str]:
    """An override, or each of those that a list of values stands for."""
    key = override.get_key_element()
    if not override.is_sweep_override():
        return [override.input_line]
    if override.is_discrete_sweep():
        values = [f"{key}={value}" for value in override.sweep_string_iterator()]
    elif enumerated:
        raise ConfigError(f"{override.input_line} is not a list, which hydra/sweeper=basic needs")
    else:
        values = [f"{key}={override.value().start}"]
    if not values:
        raise ConfigError(f"{override.input_line} holds no value")
    return values


def _composed(overrides: Sequence[str]) -> DictConfig:
    config = hydra.compose("config", list(overrides), return_hydra_config=True)
    refuse_what_is_fixed(config, _own)
    return config


@functools.cache
def _own(launcher: str, sweeper: str) -> DictConfig:
    with _hydra(None):  # nobody's folder is searched
        choices = [f"hydra/launcher={launcher}", f"hydra/sweeper={sweeper}"]
        return hydra.compose("config", choices, return_hydra_config=True)


def _job(config: DictConfig, number: int = 0, common: DictConfig | None = None) -> Job:
    with open_dict(config):
        if common is not None:
            OmegaConf.copy_cache(from_config=common, to_config=config)
            config.hydra.job.num = number
            config.hydra.job.id = f"{config.hydra.job.name}_{number}"
        HydraConfig.instance().set_config(config)  # for what refers to ${hydra:...}
        run, sweep = config.hydra.run, config.hydra.sweep
        folder = Path(run.dir) if common is None else Path(sweep.dir, sweep.subdir)
        del config["hydra"]
    return typed_config(config), folder


def normalised(overrides: Sequence[str]) -> list[str]:
    """Overrides as Hydra takes them: without a plus where something is there already, and with bodies
    from files as choices of their own.

    Raises:
        ConfigError: for what would quietly mean something else.
    """
    normal: list[str] = []
    for override in _parsed(_spelled(overrides)):
        key, value, line = override.key_or_group, override.value(), override.input_line
        if override.is_add() and key in (*GROUPS, "plugins"):
            line = line.removeprefix("+")
        for one in getattr(value, "list", [value]):  # of a sweep
            if key in GROUPS and isinstance(one, (int, float, list, dict)):
                raise ConfigError(f"{line} is not a choice; give {key} the name of one")
            if key.startswith("robot.") and isinstance(one, dict):
                raise ConfigError(f"{line} would be merged into another body; name a FILE.yaml")
        normal.append(line)
    return normal


def _parsed(overrides: Sequence[str]) -> list[Override]:
    with explained():
        return OverridesParser.create().parse_overrides(list(overrides))


def _spelled(overrides: Sequence[str]) -> Iterator[str]:
    """Overrides in Hydra's grammar: robots that are files are choices, and letters of any alphabet are
    in quotes.
    """
    files: dict[str, Path] = {}

    def choice(text: str) -> str:
        path = Path(text.strip(" '\"")).expanduser()
        # Called as no other choice is.
        name = re.sub(r"\W", "-", path.stem, flags=re.ASCII) + "-file"
        if files.setdefault(name, path) != path:
            raise ConfigError(f"{files[name]} and {path} would both be robot={name}; rename one")
        node = dataclasses.asdict(load_robot(path))
        ConfigStore.instance().store(name, node, group="robot")
        return name

    for text in overrides:
        key, equals, value = text.partition("=")
        if not value.isascii() and not {*value} & {*"'\"[]{}(),"}:
            value = f"'{value}'"
        if key.lstrip("+") != "robot" or not value:
            yield f"{key}{equals}{value}"
        elif _FILE.search(value) and Path(value.strip("'")).is_file():  # whatever its name
            yield f"{key}={choice(value)}"
        else:
            yield f"{key}={_FILE.sub(lambda found: choice(found[0]), value)}"


def parse(overrides: Sequence[str], where: str) -> list[Override]:
    """Overrides of a run that is there, which each set one key to one value; imports their plugins.

    Args:
        overrides: such as ``ppo.iterations=50``.
        where: where they stand, for messages.

    Raises:
        ConfigError: for anything else.
    """
    parsed = _parsed(normalised(overrides))
    for override in parsed:
        hydras = override.key_or_group.startswith("hydra")
        if override.is_sweep_override() or override.is_delete() or hydras:
            raise ConfigError(f"{override.input_line} has no meaning {where}")
    _import_plugins(parsed)
    return parsed


def amended(saved: dict, overrides: Sequence[Override], learning: bool = True) -> Config:
    """The configuration that a run was started with, with overrides applied.

    ``physics=OPTION`` changes how the bodies are stepped, and leaves these as they were. The run's own
    plugins are not imported.

    Raises:
        ConfigError: for an option that is not there, or a key that cannot be set so.
    """
    config = OmegaConf.create({**saved, "plugins": []})
    for override in overrides:
        key, value = override.key_or_group, override.value()
        chosen = key in GROUPS and isinstance(value, str)
        value = read_choice(key, value) if chosen else value
        with explained():
            merge = key == "physics" or not chosen
            OmegaConf.update(config, key, value, merge=merge, force_add=True)
    changed = typed_config(config, learning)
    changed.physics.require()
    return changed


def register(overrides: Sequence[str] = ()) -> None:
    """Tells Hydra the schema, and what ``conf/`` computes.

    Args:
        overrides: whose plugins are imported first, as these may bring learners with keys of their own.
    """
    _import_plugins(_parsed(overrides))
    known = {name: learners.get(name) for name in learners.names()}
    parts = [(name, part, dataclasses.field(default_factory=part)) for name, part in known.items()]
    schema = dataclasses.make_dataclass("Schema", parts, bases=(Config,))
    node = OmegaConf.structured(schema)
    node.task = TaskConfig
    for name in ("obs", "arena", "task", "network", *known):
        OmegaConf.set_struct(node[name], False)  # their keys are those of what is chosen by name
    ConfigStore.instance().store("locomotion", node)
    OmegaConf.register_new_resolver("locomotion.jobs_at_once", _jobs_at_once, replace=True)
    OmegaConf.register_new_resolver("locomotion.table", table, replace=True)


def _import_plugins(overrides: Sequence[Override]) -> None:
    for override in overrides:
        if override.key_or_group == "plugins" and isinstance(override.value(), list):
            import_plugins(map(str, override.value()))


class OwnFolder(SearchPathPlugin):
    """A folder of one's own, which Hydra searches after the project's."""

    path: Path | str | None = None

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Adds it, if there is one."""
        if self.path is not None:
            search_path.append("command-line", f"file://{Path(self.path).resolve()}")


@contextmanager
def _hydra(config_dir: Path | str | None) -> Iterator[None]:
    """Hydra with the project's configuration, and afterwards as it was."""
    base, details, job = VersionBase.instance(), HydraConfig.instance(), JobRuntime.instance()
    others, store = GlobalHydra.instance(), ConfigStore.instance()
    before = base.version_base, details.cfg, job.conf, others.hydra, store.repo, OwnFolder.path
    Plugins.instance().register(OwnFolder)
    OwnFolder.path = config_dir
    others.clear()
    job.conf = OmegaConf.create()
    # An application's own "config" would be taken for the schema of this one's.
    groups = {name: part for name, part in store.repo.items() if isinstance(part, dict)}
    store.repo = {**groups, "locomotion.yaml": store.repo["locomotion.yaml"]}
    try:
        with hydra.initialize_config_dir(str(conf_dir()), job_name="train", version_base="1.3"):
            yield
    finally:
        others = GlobalHydra.instance()
        base.version_base, details.cfg, job.conf, others.hydra, store.repo, OwnFolder.path = before


def _jobs_at_once(threads: int | None) -> int:
    """How many jobs of a sweep the usable cores have room for, each with so many threads."""
    from joblib import cpu_count  # knows of affinity and of a container's share

    return max(1, cpu_count() // (threads or cpu_count()))
