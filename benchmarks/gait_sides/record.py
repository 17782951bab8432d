"""The record of a side: a line of JSON for each iteration."""

from __future__ import annotations

import json
import time
from typing import Any, Self

#: Exit status of a side whose packages are not installed.
MISSING_PACKAGE = 3


class Recorder:
    """Writes what an iteration's robots earned, and when it ended.

    A line has ``seconds`` since the process was started, ``steps``, all control steps until then, and
    ``reward``, the mean over the iteration's control steps (m).

    Args:
        path: the file.
        spawned: when the process was started, by :func:`time.time`.
    """

    def __init__(self, path: str, spawned: float) -> None:
        self._file = open(path, "w", encoding="utf-8")  # noqa: SIM115  closed by __exit__
        self._spawned = spawned
        self._steps = 0
        self._earned: list[tuple[int, float]] = []

    def add(self, rewards: Any) -> None:
        """Notes a control step of all robots.

        Args:
            rewards: of each robot (m), an array or a tensor of shape ``(robots,)``.
        """
        self._earned.append((len(rewards), float(rewards.sum())))

    def end_iteration(self) -> None:
        """Writes the iteration that the control steps since the last one were part of."""
        taken = sum(count for count, _ in self._earned)
        self._steps += taken
        self.write(self._steps, sum(total for _, total in self._earned) / taken)
        self._earned.clear()

    def write(self, steps: int, reward: float) -> None:
        """Writes an iteration.

        Args:
            steps: control steps of all robots since the start.
            reward: mean over the iteration's control steps (m).
        """
        row = {"seconds": time.time() - self._spawned, "steps": steps, "reward": reward}
        self._file.write(json.dumps(row) + "\n")
        self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._file.close()
