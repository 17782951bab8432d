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
    swept: dict[str, list[Override]] = {}
    for override in parsed.values():
        swept.setdefault(override.get_key_element(), []).append(override)
    plain = {
        override.input_line
        for values in swept.values()
        if len(values) > 1 and _is_key(values[0], [one[0].key_or_group for one in swept.values()])
        for override in values
        if not isinstance(override.value(), dict)  # which is merged into what is there
    }
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


def _is_key(override: Override, keys: Collection[str]) -> bool:
    """Whether all that an override does is to set a key, on which no other override bears."""
    key, loader = override.key_or_group, GlobalHydra.instance().config_loader()
    if override.is_delete() or override.is_add() or override.is_force_add():
        return False
    if override.is_hydra_override() or loader.get_group_options(key) or loader.list_groups(key):
        return False
    related = (f"{key}.".startswith(f"{one}.") or one.startswith(f"{key}.") for one in keys)
    return sum(related) == 1  # itself
