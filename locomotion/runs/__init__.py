"""What a run leaves in its folder: its record, checkpoints, metrics, and the loggers beside them.

Only what is light is imported here; the rest is taken from its module.
"""

from locomotion.runs.folder import (
    RunError,
    RunStopped,
    differences,
    free_keys,
    is_finished,
    read_config,
    read_record,
    record,
)

__all__ = [
    "RunError",
    "RunStopped",
    "differences",
    "free_keys",
    "is_finished",
    "read_config",
    "read_record",
    "record",
]
