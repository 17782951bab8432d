"""The command line of training: Hydra, with mistakes answered in one line.

The configuration of every job is composed and checked before Hydra starts any of them, so a typo in
the last job of a sweep is found before the first one runs.
"""

from __future__ import annotations

import argparse
import re
import signal
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import hydra
from filelock import FileLock, Timeout
from hydra._internal.utils import get_args_parser
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from locomotion.command_line.composing import amend, compose_job, parse, register, split_sweep
from locomotion.command_line.refusal import refuse, require_writable
from locomotion.config import Config, ConfigError, conf_dir, typed
from locomotion.runs import (
    RunError,
    RunStopped,
    differences,
    is_finished,
    read_config,
    record,
)

Job = Callable[[Config, Path], None]

#: What torch says on a CPU and on a GPU, and Warp, when there is no memory left.
_NO_MEMORY = "can't allocate memory|out of memory|Failed to allocate"


def launch(job: Job) -> None:
    """Runs ``job(config, folder)`` with the configuration that the command line asks for.

    A configuration that cannot be used ends the process with one line on standard error and exit
    status 2; a run that cannot go on, with 1; one that was asked to stop, with 130.

    Args:
        job: called once for each job of a sweep, with the checked configuration and the folder for
            its output.
    """
    register()
    # A launcher that runs jobs side by side takes them along when it is interrupted, not when killed.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        arguments = _parse()
        folder, overrides = _resumed(arguments)
        if folder is not None:
            _resume(job, folder, overrides)
            return
        if not arguments.shell_completion:
            _check(arguments)

        def run(config: DictConfig) -> None:
            details = HydraConfig.get()
            checked = typed(Config, config)
            # As it was checked: what referred to a time or a job's number has its value by now.
            files = {
                "config": OmegaConf.structured(checked),
                "hydra": {"hydra": details},
                "overrides": details.overrides.task,
            }
            _run(job, checked, Path(details.runtime.output_dir), files)

        hydra.main(version_base="1.3", config_path=str(conf_dir()), config_name="config")(run)()
    except (ConfigError, RunError) as error:
        refuse(str(error))
    except KeyboardInterrupt as error:
        print(str(error) or "interrupted", file=sys.stderr)
        sys.exit(130)


def _parse() -> argparse.Namespace:
    parser = get_args_parser()
    parser.error = refuse
    arguments = parser.parse_args()
    if arguments.experimental_rerun is not None:
        raise ConfigError("--experimental-rerun runs what is in a file; use resume=FOLDER")
    for name in ("config_path", "config_name"):
        if getattr(arguments, name) is not None:
            raise ConfigError(f"--{name.replace('_', '-')} has no meaning here; use --config-dir")
    if arguments.config_dir is not None and not Path(arguments.config_dir).is_dir():
        raise ConfigError(f"--config-dir={arguments.config_dir} is no folder")
    if (arguments.resolve or arguments.package) and not arguments.cfg:
        raise ConfigError("--resolve and --package go with --cfg")
    if arguments.multirun and (arguments.cfg or arguments.run):
        raise ConfigError("--multirun goes neither with --cfg nor with --run")
    return arguments


def _resumed(arguments: argparse.Namespace) -> tuple[Path | None, list[str]]:
    """The folder that ``resume=FOLDER`` names, if it is there, and the other overrides."""
    folders = [text[7:] for text in arguments.overrides if text.startswith("resume=")]
    others = [text for text in arguments.overrides if not text.startswith("resume=")]
    if len(folders) > 1:
        raise ConfigError("resume names several folders; a command goes on with one run")
    if folders and arguments.multirun:
        raise ConfigError("resume=FOLDER goes on with one run; a sweep goes on when started again")
    flags = {name: value for name, value in vars(arguments).items() if name != "overrides"}
    if folders and any(flags.values()):
        raise ConfigError("resume=FOLDER goes with KEY=VALUE, and with no flag")
    return (Path(folders[0]) if folders else None), others


def _resume(job: Job, folder: Path, overrides: list[str]) -> None:
    """Goes on with the run in a folder, in which only what leaves its numbers alone may change."""
    saved = OmegaConf.create(read_config(folder))
    before = typed(Config, saved).ppo.iterations
    amend(saved, parse(overrides, "beside resume=FOLDER"))
    config = typed(Config, saved)
    for key, (there, asked) in differences(folder, config).items():
        if key != "ppo.iterations":
            raise ConfigError(f"{asked} would change the run in {folder}, which has {there}")
    if config.ppo.iterations < before:
        raise ConfigError(
            f"ppo.iterations={config.ppo.iterations} must be at least the {before} of the run"
        )
    config.physics.require()
    require_writable(folder)
    _run(job, config, folder, {"config": OmegaConf.structured(config)}, resumed=True)


def _check(arguments: argparse.Namespace) -> None:
    """Composes the configuration of every job, and looks at their folders if they are to run.

    Raises:
        ConfigError: if one cannot be used.
        RunError: if one's folder cannot.
    """
    place = None if arguments.config_dir is None else Path(arguments.config_dir)
    informs = arguments.cfg or arguments.help or arguments.hydra_help or arguments.info
    jobs = split_sweep(arguments.overrides, arguments.multirun, place)
    taken = set()
    for number, job in enumerate([arguments.overrides] if jobs is None else jobs):
        config, folder = compose_job(job, None if jobs is None else number, place)
        if folder in taken:
            raise ConfigError(
                f"two jobs would write to {folder}; hydra.sweep.subdir tells jobs apart"
            )
        taken.add(folder)
        if not informs:
            config.physics.require()
            require_writable(folder)
            is_finished(folder, config)


def _run(
    job: Job, config: Config, folder: Path, files: Mapping[str, Any], resumed: bool = False
) -> None:
    """Runs a job unless that was done before; ``files`` is what to record of it."""
    try:
        with FileLock(folder / ".lock", blocking=False):
            # A resumed run differs from what is recorded, but only as it may.
            if resumed:
                record(folder, **files)
            if is_finished(folder, config):
                print(f"{folder}: finished before, skipped", flush=True)
                return
            if not resumed:
                record(folder, **files)
            job(config, folder)
    except Timeout:
        refuse(f"{folder}: another process is training there")
    except (ConfigError, RunError) as error:
        refuse(str(error))
    except RunStopped as error:
        refuse(str(error), status=1)
    except OSError as error:
        refuse(f"{error.filename or folder}: {error.strerror or error}", status=1)
    except (MemoryError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and not re.search(_NO_MEMORY, str(error)):
            raise
        refuse(
            f"not enough memory for env.num_envs={config.env.num_envs} robots that take"
            f" ppo.steps={config.ppo.steps} each",
            status=1,
        )
