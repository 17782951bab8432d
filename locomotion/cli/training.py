"""The command line of training: Hydra, with mistakes answered in one line.

The configuration of every job is composed and checked before Hydra starts any of them, so a typo in
the last job of a sweep is found before the first one runs.
"""

from __future__ import annotations

import argparse
import shlex
import signal
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from locomotion.cli.composing import amended, compose_jobs, normalised, parse, register
from locomotion.cli.refusal import refuse, refusing
from locomotion.config import Config, typed_config
from locomotion.options import ConfigError, conf_dir, import_plugins
from locomotion.options.paths import read_path
from locomotion.runs import differences, is_finished, read_config, require_writable
from locomotion.training.execute import execute

_SWITCHES = ("--help -h", "--hydra-help", "--multirun -m", "--resolve", "--shell-completion -sc")
_INFORMATION = ("all", "config", "defaults", "defaults-tree", "plugins", "searchpath")


def main() -> None:
    """Trains what the command line asks for.

    A configuration that cannot be used ends the process with one line on standard error and exit
    status 2; a run that cannot go on, with 1; one that was asked to stop, with 130.
    """
    # A launcher that runs jobs side by side stops them when it is interrupted, not when killed. Commands
    # that a script has put into the background were started to ignore SIGINT.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    with refusing():
        overrides, flags = _parse()
        resumed = [text for text in overrides if text.startswith("resume=")]
        if resumed:
            _resume(resumed, [text for text in overrides if text not in resumed], flags)
            return
        overrides = normalised(overrides)
        register(overrides)
        _check(overrides, flags)
        given = {f"--{name.replace('_', '-')}": value for name, value in flags.items()}
        texts = (flag if value is True else f"{flag}={value}" for flag, value in given.items())
        sys.argv[1:] = [*overrides, *texts]
        hydra.main(version_base="1.3", config_path=str(conf_dir()), config_name="config")(run_job)()


def run_job(config: DictConfig) -> float:
    """Runs a job that Hydra has composed; its result is the final reward, for sweepers."""
    with refusing():
        import_plugins(config.plugins)  # a process of its own has not; the command line named them
        details = HydraConfig.get()
        # As it was checked: what referred to a time or a job's number has its value by now.
        files = {"hydra": {"hydra": details}, "overrides": details.overrides.task}
        # As it is written: a name may have what would refer to something.
        folder = OmegaConf.to_container(details.runtime, resolve=False)["output_dir"]
        alone = details.mode is RunMode.RUN
        return _run(typed_config(config), Path(folder), alone, files=files)


def _run(config: Config, folder: Path, alone: bool, **options: Any) -> float:
    result = execute(config, folder, **options)
    done = "finished before, skipped" if result.skipped else _earned(config, result.reward)
    print(f"{folder}: {done}", flush=True)
    if alone and not result.skipped:  # the lines of a sweep's jobs stand below one another
        run = shlex.quote(f"run={folder}")
        print(f"python -m locomotion.watch {run} web=true shows the gait", flush=True)
    return result.reward


def _earned(config: Config, reward: float) -> str:
    when = "in the last ten iterations"
    paid = {name: options.get("weight", 1) for name, options in config.task.rewards.items()}
    if paid != {"distance": 1}:
        return f"a reward of {reward:.4f} per action {when}"
    return f"{reward:.4f} m per action {when}, {config.env.control_frequency * reward:.2f} m/s"


def _parse() -> tuple[list[str], dict[str, Any]]:
    """The overrides, and those of Hydra's flags that are given and have a meaning here."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.error = refuse  # in one line, without the usage
    parser.add_argument("overrides", nargs="*")
    for flag in _SWITCHES:
        parser.add_argument(*flag.split(), action="store_true")
    parser.add_argument("--cfg", "-c", choices=("job", "hydra", "all"))
    parser.add_argument("--info", "-i", nargs="?", const="all", choices=_INFORMATION)
    parser.add_argument("--package", "-p")
    parser.add_argument("--config-dir", "-cd")
    given = vars(parser.parse_intermixed_args())
    flags = {name: value for name, value in given.items() if value or value == ""}
    if "config_dir" in flags:
        flags["config_dir"] = Path(read_path(flags["config_dir"]))
        if not flags["config_dir"].is_dir():
            raise ConfigError(f"--config-dir={flags['config_dir']} is not a folder")
    if flags.keys() & {"resolve", "package"} and "cfg" not in flags:
        raise ConfigError("--resolve and --package go with --cfg")
    if flags.keys() >= {"multirun", "cfg"}:
        raise ConfigError("--multirun does not go with --cfg")
    return flags.pop("overrides", []), flags


def _check(overrides: Sequence[str], flags: Mapping[str, Any]) -> None:
    """Composes the configuration of every job, and looks at their folders if they are to run."""
    if "shell_completion" in flags:
        return  # these are no overrides
    taken = set()
    for config, folder in compose_jobs(overrides, "multirun" in flags, flags.get("config_dir")):
        if folder in taken:
            raise ConfigError(f"two jobs would write to {folder}; hydra.sweep.subdir names folders")
        taken.add(folder)
        if not flags.keys() - {"multirun", "config_dir"}:  # the others only inform
            config.physics.require()
            require_writable(folder)
            is_finished(folder, config)


def _resume(resumed: Sequence[str], overrides: list[str], flags: Mapping[str, Any]) -> None:
    """Resumes the run in a folder, in which only what leaves its numbers alone may change."""
    if len(resumed) > 1 or flags:
        raise ConfigError("resume=FOLDER resumes one run, with KEY=VALUE and without flags")
    folder = Path(read_path(resumed[0].removeprefix("resume=")))
    amendments = parse(overrides, "with resume=FOLDER")
    saved = read_config(folder)
    least = amended(saved, []).learner.iterations
    config = amended(saved, amendments)
    iterations = f"{config.algorithm}.iterations"
    for key, (there, asked) in differences(folder, config).items():
        if key != iterations:
            raise ConfigError(f"{asked} would change the run in {folder}, which has {there}")
    if (asked := config.learner.iterations) < least:
        raise ConfigError(f"{iterations}={asked} must be at least the {least} of the run")
    require_writable(folder)
    _run(config, folder, alone=True, resumed=True)
