"""The tables of ``--help``; the text of training's is ``conf/hydra/help/locomotion.yaml``."""

from __future__ import annotations

from collections.abc import Iterable

from locomotion.config import all_keys
from locomotion.options import readings, rewards, summary


def table(what: str) -> str:
    """The rows about ``keys``, ``readings`` or ``rewards``."""
    if what == "readings":
        known = {name: readings.get(name) for name in readings.names()}
        return listed(
            (name, f"{reading.meaning}{f' ({reading.unit})' if reading.unit else ''}")
            for name, reading in known.items()
        )
    if what == "rewards":
        known = {name: (rewards.get(name).__doc__ or "").strip() for name in rewards.names()}
        return listed((name, text.partition("\n")[0].rstrip(".")) for name, text in known.items())
    keys = dict(all_keys())
    return listed((name, summary(field)) for name, field in keys.items() if field.metadata)


def listed(rows: Iterable[tuple[str, str]]) -> str:
    """Rows of two columns."""
    rows = list(rows)
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"  {name:{width}}  {text}" for name, text in rows)
