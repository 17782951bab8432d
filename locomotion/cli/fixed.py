"""What of Hydra's own part of a configuration may be set, as a configuration may come from a stranger."""

from __future__ import annotations

import functools
from typing import Any

import hydra
from omegaconf import DictConfig, OmegaConf

from locomotion.config import flat
from locomotion.options import ConfigError

#: The launchers and sweepers that may be chosen, and the keys of each that may be set. One more is one
#: more line.
ALLOWED: dict[str, dict[str, tuple[str, ...]]] = {
    "launcher": {
        "basic": (),
        "parallel": ("n_jobs",),
    },
    "sweeper": {
        "basic": ("params",),
        "optuna": ("params", "n_trials", "n_jobs", "direction", "study_name"),
    },
}
#: Keys that may be set whatever is chosen. The rest names what Hydra calls, what logging opens and what a
#: process is told by its environment.
_SETTABLE = (
    *("job.config", "job.config_name", "job.id", "job.name", "job.num", "job.override_dirname"),
    *("job.sweep", "mode", "overrides", "run.dir", "runtime", "searchpath", "sweep.dir"),
    "sweep.subdir",
)


def refuse_what_is_fixed(config: DictConfig) -> None:
    """Raises a :class:`ConfigError` if Hydra's part is set to what only the project may set."""
    choices = {kind: str(config.hydra.runtime.choices[f"hydra/{kind}"]) for kind in ALLOWED}
    settable = list(_SETTABLE)
    for kind, choice in choices.items():
        if choice not in ALLOWED[kind]:
            known = ", ".join(ALLOWED[kind])
            raise ConfigError(f"hydra/{kind}={choice} is not allowed; choose from {known}")
        settable += [f"{kind}.{name}" for name in ALLOWED[kind][choice]]
    fixed = _fixed(*choices.values())
    asked = _as_written(config)
    for key in [*asked, *(fixed.keys() - asked.keys())]:
        free = any(key == name or key.startswith(f"{name}.") for name in settable)
        if not free and asked.get(key) != fixed.get(key):
            raise ConfigError(f"hydra.{key}={asked.get(key)} is fixed; it stays {fixed.get(key)}")


@functools.cache
def _fixed(launcher: str, sweeper: str) -> dict[str, Any]:
    """Hydra's part of the project's own configuration, with one of its launchers and sweepers."""
    overrides = [f"hydra/launcher={launcher}", f"hydra/sweeper={sweeper}"]
    return _as_written(hydra.compose("config", overrides, return_hydra_config=True))


def _as_written(config: DictConfig) -> dict[str, Any]:
    """Hydra's part of a configuration by key, with what refers to something else as it was written."""
    return dict(flat(OmegaConf.to_container(config.hydra, resolve=False)))
