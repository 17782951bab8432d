"""What cannot be done is said in one line, before anything is computed for it where that can be."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import NoReturn

from locomotion.runs import RunError


def refuse(message: str, status: int = 2) -> NoReturn:
    """Ends the process with one line on standard error."""
    print(f"error: {message}", file=sys.stderr)
    sys.exit(status)


def require_writable(folder: Path) -> None:
    """Raises a :class:`RunError` if nothing can be written to a folder, which need not exist yet."""
    try:
        there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise RunError(f"{folder} cannot be written: {error.strerror}") from error
