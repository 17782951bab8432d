"""The table of readings as dm-control's observables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable

from locomotion.envs.readings import Reading
from locomotion.options import readings
from locomotion.tasks.walk_away import WalkAway


def add_observables(task: WalkAway, enabled: Sequence[str]) -> None:
    """Gives a task an observable for each reading, for ``composer.Environment``.

    Args:
        task: the task.
        enabled: the readings that are observed; the others can be enabled.
    """
    for name in dict.fromkeys([*readings.names(), *enabled]):
        found = observable.Generic(_reader(task, readings.get(name)))
        found.enabled = name in enabled
        task.task_observables[name] = found


def _reader(task: WalkAway, reading: Reading):
    def read(physics: mjcf.Physics) -> np.ndarray:
        return reading.read(task.state(physics))[0].numpy()

    return read
