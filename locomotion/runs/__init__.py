"""The folder of a run: its record, checkpoints and metrics, and the loggers that show them.

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
    require_writable,
    typed_record,
)

__all__ = [
    "RunError",
    "RunStopped",
    "differences",
    "is_finished",
    "read_config",
    "read_record",
    "record",
    "require_writable",
    "typed_record",
]
