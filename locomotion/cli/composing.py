"""A command line into the configuration and the folder of each of its jobs.

The jobs of a sweep are composed as Hydra itself will compose them, so that all of them are checked
before the first one runs, and Hydra's own part of the configuration before Hydra acts on it.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict, read_write
from tqdm import tqdm

from hydra_plugins.locomotion_sweeps.grid import jobs_of
from locomotion.cli.help import table
from locomotion.cli.refusal import explained
from locomotion.composition import application, composed, configurations, own_store
from locomotion.config import GROUPS, Config, typed_config
from locomotion.options import ConfigError, import_plugins, learners, read_choice
from locomotion.options.paths import PATH_KEYS, quoted, read_path
from locomotion.robots import RobotConfig, load_robot
from locomotion.runs import typed_record
from locomotion.tasks.options import TaskConfig

Job = tuple[Config, Path]
#: A YAML file in a value, in quotes or up to what separates values.
_FILE = re.compile(r"""(['"])(\\.|(?!\1).)+\.ya?ml\1|[^,()'"]+\.ya?ml(?=[,)]|$)""", re.DOTALL)


def compose(*overrides: str, config_dir: Path | str | None = None) -> Config:
    """See :func:`locomotion.compose`; another Hydra application around it is left as it is."""
    with own_store():
        given = normalised(overrides)
        register(given)
        with application(config_dir), explained(config_dir):
            return _job(composed(given))[0]


def compose_jobs(
    overrides: Sequence[str], multirun: bool = False, config_dir: Path | str | None = None
) -> list[Job]:
    """The configuration and the folder of each job, as Hydra will compose them.

    An experiment has lists of its own, which those on the command line replace, and may ask for a sweep.
    Another sweeper than the project's own finds its jobs as it goes; then there is one, of first values.

    Args:
        overrides: those of the command line, as :func:`normalised` returns them.
        multirun: whether it asks for a sweep.
        config_dir: a folder with choices of one's own.

    Raises:
        ConfigError: if one of the jobs cannot be used.
    """
    register(overrides)
    with application(config_dir), explained(config_dir):
        swept = [o.input_line for o in _parsed(overrides) if o.is_sweep_override()]
        common = composed([line for line in overrides if line not in swept])
        if not multirun and common.hydra.mode is not RunMode.MULTIRUN:
            if swept:
                raise ConfigError(f"{swept[0]}: several values need --multirun")
            return [_job(common)]
        loader = GlobalHydra.instance().config_loader()
        first = common.hydra.runtime.choices["hydra/sweeper"] != "grid"
        jobs = jobs_of(overrides, common.hydra.sweeper.get("params"), loader, first)
        HydraConfig.instance().set_config(common)
        str(common.hydra.sweep.dir)  # the time in it is that of all jobs
        # Without a terminal, or when it takes no longer than a second, there is no bar.
        what = f"checking {len(jobs)} jobs"
        shown = tqdm(configurations(jobs), what, len(jobs), delay=1, disable=None, leave=False)
        return [_job(config, number, common) for number, config in enumerate(shown)]


def _job(config: DictConfig, number: int = 0, common: DictConfig | None = None) -> Job:
    with read_write(config.hydra), open_dict(config.hydra):
        if common is not None:
            OmegaConf.copy_cache(from_config=common, to_config=config)
            config.hydra.job.num = number
            config.hydra.job.id = f"{config.hydra.job.name}_{number}"
    HydraConfig.instance().set_config(config)  # for what refers to ${hydra:...}
    run, sweep = config.hydra.run, config.hydra.sweep
    folder = Path(run.dir) if common is None else Path(sweep.dir, sweep.subdir)
    own = [name for name in config if name != "hydra" and not OmegaConf.is_missing(config, name)]
    values = {name: config[name] for name in own}
    for name in filter(lambda name: OmegaConf.is_config(values[name]), own):
        values[name] = OmegaConf.to_container(values[name], resolve=True)
    return typed_config(values), folder


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
    """Overrides in Hydra's grammar: robots that are files are choices, and paths and letters of any
    alphabet are in quotes.
    """
    files: dict[str, Path] = {}

    def choice(text: str) -> str:
        path = Path(read_path(text))
        # Called as no other choice is.
        name = re.sub(r"\W", "-", path.stem, flags=re.ASCII) + "-file"
        if files.setdefault(name, path) != path:
            raise ConfigError(f"{files[name]} and {path} would both be robot={name}; rename one")
        node = dataclasses.asdict(load_robot(path))
        ConfigStore.instance().store(name, node, group="robot")
        return name

    for text in overrides:
        key, equals, value = text.partition("=")
        name = key.lstrip("+")
        if equals and name in PATH_KEYS and (name, value) != ("output", "null"):
            value = quoted(read_path(value))
        elif name == "robot":
            file = value.endswith((".yaml", ".yml"))
            if file and ("," not in value or Path(read_path(value)).is_file()):
                value = choice(value)
            else:
                value = _FILE.sub(lambda found: choice(found[0].strip()), value)
        elif not value.isascii() and not {*value} & {*"'\"[]{}(),"}:
            value = quoted(value)
        yield f"{key}{equals}{value}"


def parse(overrides: Sequence[str], where: str) -> list[Override]:
    """Overrides of a run that is there, which each set one key to one value; imports their plugins.

    Args:
        overrides: such as ``ppo.iterations=50``.
        where: where they stand, for messages.

    Raises:
        ConfigError: for anything else.
    """
    parsed = _parsed(normalised(overrides))
    for text, override in zip(overrides, parsed, strict=True):
        hydras = override.key_or_group.startswith("hydra")
        if override.is_sweep_override() or override.is_delete() or hydras:
            raise ConfigError(f"{text} has no meaning {where}")
    _import_plugins(parsed)
    return parsed


def amended(saved: dict, overrides: Sequence[Override], learning: bool = True) -> Config:
    """The configuration that a run was started with, with overrides applied.

    ``physics=OPTION`` changes how the bodies are stepped, and leaves these as they were. The run's own
    plugins are not imported.

    Raises:
        ConfigError: for an option that is not there, or a key that cannot be set so.
    """

    def change(config: DictConfig) -> None:
        for override in overrides:
            key, value = override.key_or_group, override.value()
            chosen = key in GROUPS and isinstance(value, str)
            value = read_choice(key, value) if chosen else value
            with explained():
                merge = key == "physics" or not chosen
                OmegaConf.update(config, key, value, merge=merge, force_add=True)

    changed = typed_record(saved, change, learning)
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
    node.robot, node.task = RobotConfig, TaskConfig
    node.robot.name = "${hydra:runtime.choices.robot}"  # of a body that does not say
    for name in ("obs", "critic", "arena", "task", "network", *known):
        OmegaConf.set_struct(node[name], False)  # their keys are those of what is chosen by name
    ConfigStore.instance().store("locomotion", node)
    OmegaConf.register_new_resolver("locomotion.jobs_at_once", _jobs_at_once, replace=True)
    OmegaConf.register_new_resolver("locomotion.job_cores", _job_cores, replace=True)
    OmegaConf.register_new_resolver("locomotion.job_gpus", _job_gpus, replace=True)
    OmegaConf.register_new_resolver("locomotion.table", table, replace=True)


def _import_plugins(overrides: Sequence[Override]) -> None:
    for override in overrides:
        if override.key_or_group == "plugins" and isinstance(override.value(), list):
            import_plugins(map(str, override.value()))


def _job_cores(threads: int | None) -> int:
    """The cores that a job on a cluster asks for: one unless it says how many threads it has."""
    return threads or 1


def _job_gpus(device: str) -> int:
    """The GPUs that a job on a cluster asks for."""
    return int(device.startswith("cuda"))


def _jobs_at_once(threads: int | None) -> int:
    """The number of jobs, each with some threads, that the usable cores have room for."""
    from joblib import cpu_count  # knows of affinity and of a container's share

    return max(1, cpu_count() // (threads or cpu_count()))
