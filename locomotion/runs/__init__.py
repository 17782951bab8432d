"""What a run leaves in its folder: its record, checkpoints, metrics, and the loggers that show them.

Only light modules are imported here; the others are imported by name.
"""

from locomotion.runs.folder import (
    RunError,
    RunStopped,
    differences,
    is_finished,
    read_config,
    read_record,
    record,
)

__all__ = [
    "RunError",
    "RunStopped",
    "differences",
    "is_finished",
    "read_config",
    "read_record",
    "record",
]
