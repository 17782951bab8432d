"""The keys of Hydra's own that a configuration may set, as it may come from a stranger."""

from __future__ import annotations

import re
from collections.abc import Callable

from omegaconf import DictConfig, OmegaConf

from locomotion.options import ConfigError, flat

#: The launchers and sweepers that may be chosen, and the keys of each that may be set. One more is one
#: more line.
ALLOWED: dict[str, tuple[str, ...]] = {
    "hydra/launcher=basic": (),
    "hydra/launcher=parallel": ("n_jobs",),
    "hydra/launcher=ray": ("cpus", "gpus", "memory", "retries"),
    "hydra/launcher=slurm": (
        *("partition", "account", "qos", "constraint"),
        *("time", "cpus", "gpus", "memory", "n_jobs"),
    ),
    "hydra/sweeper=grid": ("params",),
    "hydra/sweeper=optuna": ("params", "n_trials", "n_jobs", "direction", "study_name"),
}
#: Keys that may be set whatever is chosen. The rest names what Hydra calls, what logging opens and what a
#: process is told by its environment.
_SETTABLE = (
    *("job.config", "job.config_name", "job.id", "job.name", "job.num", "job.override_dirname"),
    *("job.sweep", "mode", "overrides", "run.dir", "runtime", "searchpath", "sweep.dir"),
    "sweep.subdir",
)


#: Least values of a launcher's keys that are numbers, and whether they are whole ones.
_NUMBERS = {
    "n_jobs": (1, True),
    "cpus": (1, True),
    "retries": (0, True),
    "time": (1, True),
    "gpus": (0, False),
    "memory": (0.1, False),
}
#: Keys that are words for Slurm; a newline in one would be a line of its script.
_WORDS = ("partition", "account", "qos", "constraint")


def _check_launcher(options: DictConfig) -> None:
    """Raises a :class:`ConfigError` for a value that a launcher cannot use."""
    for name, (least, whole) in _NUMBERS.items():
        value = options.get(name, least)
        number = isinstance(value, int if whole else (int, float)) and not isinstance(value, bool)
        if not number or not least <= value < 1e9:
            kind = "whole number" if whole else "number"
            raise ConfigError(f"hydra.launcher.{name}={value} must be a {kind} of at least {least}")
    for name in _WORDS:
        word = options.get(name)
        if word is not None and not re.fullmatch(r"\w[\w.,:&|*()\[\]-]*", str(word), re.ASCII):
            raise ConfigError(
                f"hydra.launcher.{name}={str(word)!r} must be a word of letters, digits and .,:&|*()[]-"
            )


def refuse_what_is_fixed(config: DictConfig, own: Callable[[str, str], DictConfig]) -> None:
    """Raises a :class:`ConfigError` if Hydra's part is set to what only the project may set.

    Args:
        config: composed from what may be a stranger's.
        own: composes the project's own configuration, with a launcher and a sweeper of these names.
    """
    settable, choices = [*_SETTABLE], config.hydra.runtime.choices
    for kind in ("launcher", "sweeper"):
        choice = f"hydra/{kind}={choices[f'hydra/{kind}']}"
        if choice not in ALLOWED:
            known = ", ".join(name for name in ALLOWED if kind in name)
            raise ConfigError(f"{choice} is not allowed; choose from {known}")
        settable += [f"{kind}.{name}" for name in ALLOWED[choice]]
    _check_launcher(config.hydra.launcher)
    own_config = own(choices["hydra/launcher"], choices["hydra/sweeper"])
    # What refers to something else is compared as it is written.
    asked, fixed = (dict(flat(OmegaConf.to_container(x.hydra))) for x in (config, own_config))
    for key in [*asked, *(fixed.keys() - asked.keys())]:
        free = any(key == name or key.startswith(f"{name}.") for name in settable)
        if not free and asked.get(key) != fixed.get(key):
            raise ConfigError(f"hydra.{key}={asked.get(key)} is fixed; it stays {fixed.get(key)}")
