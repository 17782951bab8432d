"""One side in this process: ``python -m benchmarks.gait_sides TASK``, a task as JSON.

:mod:`benchmarks.time_to_gait` starts it. A package that is missing ends it with status 3 and its name.
"""

from __future__ import annotations

import importlib
import json
import sys

from benchmarks.gait_sides import Task, module_of
from benchmarks.gait_sides.record import MISSING_PACKAGE, Recorder


def main() -> None:
    task = Task.from_json(json.loads(sys.argv[1]))
    try:
        learn = importlib.import_module(module_of(task.side)).learn
    except ModuleNotFoundError as error:
        print(error.name, file=sys.stderr)
        sys.exit(MISSING_PACKAGE)
    with Recorder(task.output, task.spawned) as recorder:
        learn(task, recorder)


if __name__ == "__main__":
    main()
