"""The command line of training: Hydra, with mistakes answered in one line.

The configuration of every job is composed and checked before Hydra starts any of them, so a typo in
the last job of a sweep is found before the first one runs.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from locomotion.cli.composing import (
    amend,
    compose_job,
    explained,
    normalised,
    parse,
    register,
    split_sweep,
)
from locomotion.cli.refusal import refuse, refusing, require_writable
from locomotion.config import Config, typed_config
from locomotion.options import ConfigError, conf_dir
from locomotion.runs import differences, is_finished, read_config
from locomotion.training.execute import execute

#: Flags of Hydra that only inform.
_INFORMING = ("help", "hydra_help", "cfg", "info", "shell_completion")


def main() -> None:
    """Trains what the command line asks for.

    A configuration that cannot be used ends the process with one line on standard error and exit
    status 2; a run that cannot go on, with 1; one that was asked to stop, with 130.
    """
    # A launcher that runs jobs side by side stops them when it is interrupted, not when killed.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with refusing():
        arguments = _parse()
        folder, overrides = _resumed(arguments)
        if folder is not None:
            _resume(folder, overrides)
            return
        place = None if arguments.config_dir is None else Path(arguments.config_dir)
        with explained(overrides):
            overrides = normalised(overrides, place)
            register(overrides)
        if not arguments.shell_completion:
            _check(arguments, overrides)
        flags = [text for text in sys.argv[1:] if text.startswith("-")]
        sys.argv[1:] = [*_without_config_dir(flags), *overrides]
        hydra.main(version_base="1.3", config_path=str(conf_dir()), config_name="config")(run_job)()


def run_job(config: DictConfig) -> float:
    """Runs a job that Hydra has composed; its result is the final reward, for sweepers."""
    with refusing():
        details = HydraConfig.get()
        # As it was checked: what referred to a time or a job's number has its value by now.
        files = {"hydra": {"hydra": details}, "overrides": details.overrides.task}
        return _run(typed_config(config), Path(details.runtime.output_dir), files)


def _run(
    config: Config, folder: Path, files: Mapping[str, Any] | None = None, resumed: bool = False
) -> float:
    result = execute(config, folder, files=files, resumed=resumed)
    if result.skipped:
        print(f"{folder}: finished before, skipped", flush=True)
    else:
        reward = f"{result.reward:.4f} m per action in the last ten iterations"
        print(f"{folder}: {reward}", flush=True)
    return result.reward


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> None:
        refuse(message)


def _parse() -> argparse.Namespace:
    """Hydra's flags, as far as they have a meaning here."""
    parser = _Parser(add_help=False, allow_abbrev=False)
    parser.add_argument("overrides", nargs="*")
    for flags in (("--help", "-h"), ("--hydra-help",), ("--multirun", "-m"), ("--resolve",)):
        parser.add_argument(*flags, action="store_true")
    parser.add_argument("--shell-completion", "-sc", action="store_true")
    parser.add_argument("--cfg", "-c", choices=("job", "hydra", "all"))
    parser.add_argument("--info", "-i", nargs="?", const="all")
    parser.add_argument("--package", "-p")
    parser.add_argument("--config-dir", "-cd")
    arguments = parser.parse_intermixed_args()
    if arguments.config_dir is not None and not Path(arguments.config_dir).is_dir():
        raise ConfigError(f"--config-dir={arguments.config_dir} is not a folder")
    if (arguments.resolve or arguments.package) and not arguments.cfg:
        raise ConfigError("--resolve and --package go with --cfg")
    if arguments.multirun and arguments.cfg:
        raise ConfigError("--multirun does not go with --cfg")
    return arguments


def _without_config_dir(flags: list[str]) -> list[str]:
    """Flags without the folder of one's own, which is in the search path by now."""
    return [flag for flag in flags if not flag.startswith(("--config-dir", "-cd"))]


def _resumed(arguments: argparse.Namespace) -> tuple[Path | None, list[str]]:
    """The folder that ``resume=FOLDER`` names, if it is there, and the other overrides."""
    folders = [text[7:] for text in arguments.overrides if text.startswith("resume=")]
    others = [text for text in arguments.overrides if not text.startswith("resume=")]
    if len(folders) > 1:
        raise ConfigError("resume names several folders; a command resumes one run")
    if folders and arguments.multirun:
        raise ConfigError("resume=FOLDER resumes one run; a sweep resumes when started again")
    flags = {name: value for name, value in vars(arguments).items() if name != "overrides"}
    if folders and any(flags.values()):
        raise ConfigError("resume=FOLDER goes with KEY=VALUE, and with no flag")
    return (Path(folders[0]) if folders else None), others


def _resume(folder: Path, overrides: list[str]) -> None:
    """Resumes the run in a folder, in which only what leaves its numbers alone may change."""
    parsed = parse(overrides, "with resume=FOLDER")
    register([override.input_line for override in parsed])
    saved = OmegaConf.create(read_config(folder))
    saved.plugins = []  # a folder's are not imported; those of the command line are
    before = typed_config(saved)
    amend(saved, parsed)
    config = typed_config(saved)
    iterations = f"{config.learner.PREFIX}iterations"
    for key, (there, asked) in differences(folder, config).items():
        if key != iterations:
            raise ConfigError(f"{asked} would change the run in {folder}, which has {there}")
    if config.learner.iterations < before.learner.iterations:
        raise ConfigError(
            f"{iterations}={config.learner.iterations} must be at least the"
            f" {before.learner.iterations} of the run"
        )
    config.physics.require()
    require_writable(folder)
    _run(config, folder, resumed=True)


def _check(arguments: argparse.Namespace, overrides: list[str]) -> None:
    """Composes the configuration of every job, and looks at their folders if they are to run.

    Raises:
        ConfigError: if one cannot be used.
        RunError: if one's folder cannot.
    """
    informs = any(getattr(arguments, name) for name in _INFORMING)
    jobs = split_sweep(overrides, arguments.multirun)
    taken = set()
    for number, job in enumerate([overrides] if jobs is None else jobs):
        config, folder = compose_job(job, None if jobs is None else number)
        if folder in taken:
            raise ConfigError(
                f"two jobs would write to {folder}; hydra.sweep.subdir tells jobs apart"
            )
        taken.add(folder)
        if not informs:
            config.physics.require()
            require_writable(folder)
            is_finished(folder, config)
