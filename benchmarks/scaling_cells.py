"""One line of the table of :mod:`benchmarks.scaling`."""

from __future__ import annotations

import dataclasses
import resource
import statistics
import sys
from pathlib import Path
from typing import Any, ClassVar

import yaml

#: Control steps in a batch, where these are enough for one of each robot.
FRAMES = 2048
#: Batches that are measured, fewer if one is long.
TURNS = 5


@dataclasses.dataclass(frozen=True)
class Cell:
    """Time and memory of training with a number of robots.

    Attributes:
        robots: how many.
        hinges: of each.
        cores: threads that step them.
        microseconds: a control step of one robot.
        parts: shares of it, by the names of ``PARTS``.
        memory: the most that the process took (GB).
    """

    PARTS: ClassVar = ("physics", "environment", "transforms", "policy", "storage", "update")

    robots: int
    hinges: int
    cores: int
    microseconds: float
    parts: dict[str, float]
    memory: float

    def cells(self) -> tuple[str, ...]:
        """The line as text."""
        shares = [f"{self.parts[name]:.0%}" for name in self.PARTS]
        sizes = (f"{self.robots:,}", str(self.hinges), str(self.cores))
        return (*sizes, f"{self.microseconds:.0f}", *shares, f"{self.memory:.2f}")


def write_body(folder: Path, hinges: int) -> Path:
    """Writes a body with four legs, hinges in a row and a brick at the end of each."""
    faces = ("front", "left", "back", "right")
    legs = {face: _leg(hinges // 4 + (number < hinges % 4)) for number, face in enumerate(faces)}
    body = {"module": "core", "children": legs}
    path = folder / f"legs{hinges}.yaml"
    path.write_text(yaml.safe_dump({"name": f"legs{hinges}", "body": body}))
    return path


def _leg(hinges: int) -> dict[str, Any]:
    outer = _leg(hinges - 1) if hinges > 1 else {"module": "brick"}
    # Hinges bend up and down, then sideways, as in a snake.
    rotation = 90 if hinges % 2 else 270
    return {"module": "hinge", "rotation": rotation, "children": {"attachment": outer}}


def measure_cell(robots: int, hinges: int, cores: int, body: Path) -> Cell:
    """Trains for a few batches: the median of their times, and of the times of their parts."""
    import torch

    from benchmarks.bare import BareBatch
    from benchmarks.ours import PARTS, Training
    from locomotion.quiet import quiet

    torch.set_num_threads(1)
    steps = max(1, FRAMES // robots)
    turns = max(1, TURNS * FRAMES // (robots * steps))
    with quiet():
        training = Training(robots, steps, f"robot={body}", f"physics.threads={cores}")
        times, updates = [], []
        for _ in range(1 + turns):  # the first one warms up
            batch, collecting = training.collect()
            updates.append(training.update(batch))
            times.append(collecting + updates[-1])
        del batch
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        bare = BareBatch(training.model, robots, training.substeps, cores)
        found = [training.parts(bare) for _ in range(turns)]
        training.close()
    taken = [statistics.median(parts[name] for parts in found) for name in PARTS]
    taken.append(statistics.median(updates[1:]) / steps)
    shares = dict(zip(Cell.PARTS, (part / sum(taken) for part in taken), strict=True))
    return Cell(
        robots=robots,
        hinges=hinges,
        cores=cores,
        microseconds=1e6 * statistics.median(times[1:]) / (robots * steps),
        parts=shares,
        memory=memory * (1 if sys.platform == "darwin" else 1024) / 1e9,
    )
