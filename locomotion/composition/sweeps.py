"""The configurations of a sweep, without composing every one of them."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Collection, Iterator, Sequence

from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from omegaconf import DictConfig, OmegaConf, read_write
from omegaconf.errors import OmegaConfBaseException

from locomotion.composition.composed import composed


def configurations(jobs: Sequence[Sequence[str]]) -> Iterator[DictConfig]:
    """The configuration of each job. Each is to be read before the next, which may be the same object.

    Hydra takes a tenth of a second for one, so jobs that differ in the values of keys alone share one in
    which these are set, as Hydra itself sets keys after all choices.
    """
    lines = [*dict.fromkeys(itertools.chain(*jobs))]
    parsed = dict(zip(lines, OverridesParser.create().parse_overrides(lines), strict=True))
    varied = {line for line in parsed if sum(line in job for job in jobs) < len(jobs)}
    plain = {line for line in varied if _is_plain(parsed[line], parsed.values())}
    shared = functools.lru_cache(maxsize=64)(composed)
    for job in jobs:
        config = shared(tuple(line for line in job if line not in plain))
        try:
            for override in (parsed[line] for line in job if line in plain):
                OmegaConf.update(config, override.key_or_group, override.value(), merge=True)
        except OmegaConfBaseException:
            config = composed(job)  # says what is wrong
        task = [parsed[line] for line in job if not parsed[line].is_hydra_override()]
        with read_write(config.hydra):
            config.hydra.overrides.task = [override.input_line for override in task]
            name = config.hydra.job.config.override_dirname
            kept = (o.input_line for o in task if o.key_or_group not in name.exclude_keys)
            joined = name.item_sep.join(sorted(kept))
            config.hydra.job.override_dirname = joined.replace("=", name.kv_sep)
        yield config


def _is_plain(override: Override, others: Collection[Override]) -> bool:
    """Whether all that an override does is to set a key, on which no other override bears."""
    key, loader = override.key_or_group, GlobalHydra.instance().config_loader()
    changes = override.is_delete() or override.is_add() or override.is_force_add()
    if changes or override.is_hydra_override() or isinstance(override.value(), dict):
        return False
    if loader.get_group_options(key) or loader.list_groups(key):
        return False
    near = (other.key_or_group for other in others if other.get_key_element() != key)
    return not any(
        f"{key}.".startswith(f"{one}.") or f"{one}.".startswith(f"{key}.") for one in near
    )
