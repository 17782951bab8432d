"""A sweeper: every combination of the values on the command line and of an experiment."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from hydra.core.config_loader import ConfigLoader
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.core.plugins import Plugins
from hydra.core.utils import JobReturn
from hydra.errors import HydraException
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, OmegaConf

#: The most jobs of a sweep.
MAX_JOBS = 10_000


def jobs_of(
    overrides: Sequence[str],
    params: dict[str, str] | None,
    loader: ConfigLoader,
    first: bool = False,
) -> list[list[str]]:
    """The overrides of each job; the last list of values varies fastest.

    Args:
        overrides: those of the command line.
        params: lists of values by key, which those of the command line replace.
        loader: finds the choices that a glob stands for.
        first: whether the first job is all that is wanted, in which an interval has its lowest value.

    Raises:
        HydraException: for values that cannot be counted, none at all, or too many.
    """
    parser = OverridesParser.create(config_loader=loader)
    lists = [f"{key}={values}" for key, values in (params or {}).items()]
    values = {
        override.get_key_element(): _values(override, first)
        for override in parser.parse_overrides([*lists, *overrides])
    }
    if math.prod(map(len, values.values())) > MAX_JOBS:
        raise HydraException(f"a sweep has at most {MAX_JOBS} jobs")
    return [list(job) for job in itertools.product(*values.values())]


def _values(override: Override, first: bool) -> list[str]:
    """An override, or each of those that a list of values stands for."""
    if not override.is_sweep_override():
        return [override.input_line]
    key = override.get_key_element()
    if override.is_interval_sweep():
        if not first:
            raise HydraException(
                f"{override.input_line} is not a list, which hydra/sweeper=grid needs"
            )
        return [f"{key}={override.value().start}"]
    try:
        most = 1 if first else MAX_JOBS + 1
        values = list(itertools.islice(override.sweep_string_iterator(), most))
    except (ValueError, HydraException) as error:
        raise HydraException(f"{override.input_line}: {error}") from error
    if not values:
        raise HydraException(f"{override.input_line} holds no value")
    if len(values) > MAX_JOBS:
        raise HydraException(f"{override.input_line}: a sweep has at most {MAX_JOBS} jobs")
    return [f"{key}={value}" for value in values]


class GridSweeper(Sweeper):
    """Launches all jobs at once, which have been composed and checked before.

    Hydra's own sweeper composes each job once more before the first one runs.

    Args:
        params: lists of values by key.
    """

    def __init__(self, params: dict[str, str] | None = None) -> None:
        self._params = params

    def setup(
        self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig
    ) -> None:
        self._loader, self._config = hydra_context.config_loader, config
        self._launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> Any:
        """Runs the jobs; their results, and what one of them raised."""
        place = Path(self._config.hydra.sweep.dir)
        place.mkdir(parents=True, exist_ok=True)
        OmegaConf.save(self._config, place / "multirun.yaml")
        jobs = jobs_of(arguments, self._params, self._loader)
        results: Iterable[JobReturn] = self._launcher.launch(jobs, initial_job_idx=0)
        for result in results:
            result.return_value  # noqa: B018  raises what the job raised
        return [results]
