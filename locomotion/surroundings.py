"""The surroundings of a process: environment variables, home, current folder, standard streams."""

from __future__ import annotations

import codecs
import contextlib
import errno
import importlib.util
import io
import logging
import os
import sys
import warnings
from collections.abc import Iterator
from multiprocessing import parent_process

#: Matplotlib's words about a home that it cannot write to, and about its list of fonts. It draws
#: without the one, and makes the other by itself.
_NEEDLESS = (
    "mkdir -p failed",
    "not a writable",
    "temporary cache",
    "font cache",
    "font_manager cache",
)


def tidy() -> None:
    """Removes what MuJoCo, dm-control or matplotlib cannot be imported with, or would complain about.

    They look at import for what they would draw with. A film finds that by itself
    (:mod:`locomotion.rendering.graphics`), figures need no window, and nothing else is drawn.

    - ``MUJOCO_GL`` of an OpenGL that is not there, as on a cluster's nodes without one;
    - ``MPLBACKEND`` of a package that is not there, as a notebook sets it for commands that run in
      another Python.
    """
    # dm-control tries to open a window at import; a machine without a screen is no reason to warn.
    for message in ("The DISPLAY environment", "X11: Failed to open", "Wayland: Failed to connect"):
        warnings.filterwarnings("ignore", message=f".*{message}")
    for name in ("matplotlib", "matplotlib.font_manager"):
        logging.getLogger(name).addFilter(_needed)
    if os.environ.get("MUJOCO_GL"):
        _require_opengl()
    backend = os.environ.get("MPLBACKEND", "")
    package = backend.removeprefix("module://").split(".")[0]
    if backend.startswith("module://") and not (package and importlib.util.find_spec(package)):
        del os.environ["MPLBACKEND"]


@contextlib.contextmanager
def lasting_streams() -> Iterator[None]:
    """Lets a command outlive its standard streams: nothing that it says can end its work.

    - What a stream's encoding has not is escaped, and file names are written as they came.
    - A stream that is closed takes everything and keeps nothing; no file gets its number.
    - Output that is no longer read, as with ``| head -1``, or a terminal that is gone, is dropped.

    Raises:
        OSError: at the end of the command, if something could not be written to standard output
            otherwise, such as with a full disk.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free: this one
    codecs.register_error("readable", _readable)
    whole = sys.stdout in (None, sys.__stdout__) and parent_process() is None  # no job within it
    if sys.stdout in (None, sys.__stdout__):
        sys.stdout = _lasting(1, sys.stdout)
    if sys.stderr in (None, sys.__stderr__):
        sys.stderr = _lasting(2, sys.stderr)
    yield
    sys.stdout.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    lost = raw.lost if isinstance(raw, _Lasting) else None
    if whole and lost is not None and lost.errno not in (errno.EPIPE, errno.EIO):
        raise OSError(lost.errno, lost.strerror, "standard output")


class _Lasting(io.FileIO):
    """A stream that drops what it cannot write.

    Attributes:
        lost: why something was dropped first.
    """

    lost: OSError | None = None

    def write(self, data: bytes) -> int | None:
        try:
            return super().write(data)
        except OSError as error:
            self.lost = self.lost or error
            return len(data)


def _lasting(number: int, stream: io.TextIOWrapper | None) -> io.TextIOBase:
    """A standard stream that lasts, in place of one that is open, or of none."""
    if stream is not None and stream.isatty() and os.name != "posix":
        stream.reconfigure(errors="readable")  # a console of Windows is not a file
        return stream
    encoding = "utf-8" if stream is None else stream.encoding
    buffer = io.BufferedWriter(_Lasting(number, "wb", closefd=False))
    return io.TextIOWrapper(buffer, encoding, "readable", line_buffering=True)


def _readable(error: UnicodeError) -> tuple[str | bytes, int]:
    """A character that cannot be encoded: a byte of a file name as it is, or what Python calls it."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    one = UnicodeEncodeError(
        error.encoding, error.object, error.start, error.start + 1, error.reason
    )
    try:
        return codecs.lookup_error("surrogateescape")(one)
    except UnicodeEncodeError:
        return codecs.lookup_error("backslashreplace")(one)


def _needed(record: logging.LogRecord) -> bool:
    return not any(words in str(record.msg) for words in _NEEDLESS)


def _require_opengl() -> None:
    try:
        import dm_control._render  # noqa: F401  without MuJoCo, and asking for more than it does
    except Exception:  # noqa: BLE001  each backend raises its own
        from locomotion.rendering.graphics import forget_opengl

        del os.environ["MUJOCO_GL"]
        forget_opengl()
