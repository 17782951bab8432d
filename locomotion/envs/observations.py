"""Observations: terms, each a reading with a past, a representation and a scale.

``conf/obs/*.yaml`` list terms by name. Nothing here imports torch until transforms are made.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from locomotion.options import Checked, ConfigError, key, readings, typed

if TYPE_CHECKING:
    from torchrl.envs import Transform


class Representation(enum.Enum):
    """Representations of an orientation."""

    quaternion = "quaternion"
    rotation_6d = "rotation_6d"
    gravity = "gravity"
    yaw = "yaw"


@dataclasses.dataclass
class ObsTerm(Checked):
    """One thing that the policy observes; an encoder of its own reads it."""

    reading: str | None = key(
        "the reading that is observed; null: the one that the term is named after", default=None
    )
    steps: int = key("how many of the last values, newest first", default=1, least=1, most=1000)
    representation: Representation | None = key(
        "of an orientation: quaternion, rotation_6d, gravity or yaw; null: as it is read",
        default=None,
    )
    scale: float = key("factor on the values", default=1.0)

    def reading_of(self, name: str) -> str:
        """The reading of a term of that name."""
        return self.reading or name


def typed_terms(options: Mapping[str, Any], section: str = "obs") -> dict[str, ObsTerm]:
    """Terms from plain values, each by its name; none is a term with default options.

    Args:
        options: terms by name.
        section: where they stand in the configuration.

    Raises:
        ConfigError: for an unknown key, or a value of the wrong type or range.
    """
    return {
        name: typed(ObsTerm, term or {}, prefix=f"{section}.{name}.")
        for name, term in options.items()
    }


def check_terms(terms: Mapping[str, ObsTerm], section: str = "obs") -> None:
    """Raises a :class:`ConfigError` for terms that cannot be observed."""
    for name, term in terms.items():
        reading = readings.get(term.reading_of(name), f"{section}.{name}.reading")
        if term.representation is not None and not reading.quaternion:
            raise ConfigError(
                f"{section}.{name}.representation={term.representation.value} must be null, as"
                f" {term.reading_of(name)} is not an orientation"
            )


def make_transforms(
    terms: Mapping[str, ObsTerm], prefix: str = ""
) -> tuple[list[Transform], list[str]]:
    """Makes the transforms that write the terms.

    Args:
        terms: by name.
        prefix: of the names of the entries that are written.

    Returns:
        The transforms; the entries to be seen, one a term.
    """
    import torch
    from torchrl.envs import ObservationNorm

    from locomotion.transforms import HingeHistory, IncludeOrientation

    transforms: list[Transform] = []
    keys = []
    for name, term in terms.items():
        entry = term.reading_of(name)
        # What is read as it is needs no transform.
        if term.representation not in (None, Representation.quaternion):
            form = term.representation.value
            transforms.append(IncludeOrientation(form, [entry], [f"{prefix}{name}_{form}"]))
            entry = f"{prefix}{name}_{form}"
        if term.scale != 1.0:
            scaled = f"{prefix}{name}_scaled"
            with torch.device("cpu"):  # whatever torch's defaults are
                scale = torch.tensor(term.scale, dtype=torch.float32)
                shift = torch.zeros_like(scale)
                transforms.append(ObservationNorm(shift, scale, [entry], [scaled]))
            entry = scaled
        if term.steps > 1:
            transforms.append(HingeHistory(term.steps, [entry], [f"{prefix}{name}_history"]))
            entry = f"{prefix}{name}_history"
        keys.append(entry)
    return transforms, keys
