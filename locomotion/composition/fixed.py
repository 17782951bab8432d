"""The keys of Hydra's own that a configuration may set, as it may come from a stranger."""

from __future__ import annotations

from collections.abc import Callable

from omegaconf import DictConfig, OmegaConf

from locomotion.options import ConfigError, flat

#: The launchers and sweepers that may be chosen, and the keys of each that may be set. One more is one
#: more line.
ALLOWED: dict[str, tuple[str, ...]] = {
    "hydra/launcher=basic": (),
    "hydra/launcher=parallel": ("n_jobs",),
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
    at_once = config.hydra.launcher.get("n_jobs", 1)
    if not isinstance(at_once, int) or at_once < 1:
        raise ConfigError(f"hydra.launcher.n_jobs={at_once} must be a number of at least 1")
    own_config = own(choices["hydra/launcher"], choices["hydra/sweeper"])
    # What refers to something else is compared as it is written.
    asked, fixed = (dict(flat(OmegaConf.to_container(x.hydra))) for x in (config, own_config))
    for key in [*asked, *(fixed.keys() - asked.keys())]:
        free = any(key == name or key.startswith(f"{name}.") for name in settable)
        if not free and asked.get(key) != fixed.get(key):
            raise ConfigError(f"hydra.{key}={asked.get(key)} is fixed; it stays {fixed.get(key)}")
