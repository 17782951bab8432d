"""What cannot be done is said in one line, before anything is computed for it where that can be."""

from __future__ import annotations

import contextlib
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

from locomotion.options import ConfigError
from locomotion.runs import RunError, RunStopped


def refuse(message: str, status: int = 2) -> NoReturn:
    """Ends the process with one line on standard error."""
    print(f"error: {message}", file=sys.stderr)
    sys.exit(status)


@contextlib.contextmanager
def refusing() -> Iterator[None]:
    """Ends the process with one line on standard error for what a user can be told.

    The exit status is 2 for what cannot be used, 1 for what cannot go on, and 130 for an interruption.
    """
    try:
        yield
    except (ConfigError, RunError) as error:
        refuse(str(error))
    except RunStopped as error:
        refuse(str(error), status=1)
    except OSError as error:
        reason = error.strerror or str(error)
        refuse(f"{error.filename}: {reason}" if error.filename else reason, status=1)
    except KeyboardInterrupt as error:
        print(str(error) or "interrupted", file=sys.stderr)
        sys.exit(130)


def require_writable(folder: Path) -> None:
    """Raises a :class:`RunError` if nothing can be written to a folder, which need not exist yet."""
    try:
        there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise RunError(f"{folder} cannot be written: {error.strerror}") from error
