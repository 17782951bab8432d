"""Files that are written whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

#: Errors of a file system that cannot sync.
_NO_SYNC = {errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EBADF}


@contextlib.contextmanager
def atomic_write(target: Path) -> Iterator[Path]:
    """A name to write to in place of ``target``, which it becomes when the block ends.

    The name is nobody else's, and has the ending of ``target``. A block that raises leaves ``target`` as
    it was; a target that is a link stays one. What was written is on the disk before it takes its place,
    so that it survives a power failure too, where the file system can promise that.

    Raises:
        OSError: if ``target`` cannot be written, which it names.
    """
    place = Path(os.path.realpath(target))
    partial = place.with_name(f".partial-{secrets.token_hex(4)}{target.suffix}")
    try:
        yield partial
        # Windows syncs files that are open for writing alone.
        with partial.open("rb+") as file:
            sync(file.fileno())
        partial.replace(place)
        _sync_folder(place.parent)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(target)) from error
    finally:
        with contextlib.suppress(NotADirectoryError):  # as its folder may be none
            partial.unlink(missing_ok=True)


def sync(descriptor: int) -> None:
    """Makes sure that what was written to an open file is on the disk.

    Some file systems, such as network shares and the shared folders of virtual machines, cannot promise
    it, and say so; there a write is as safe as they make it.
    """
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise


def remove_partial(folder: Path) -> None:
    """Removes what a process that was killed has left half written in a folder."""
    for path in folder.glob(".partial-*"):
        path.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    # Windows opens no folders, and some file systems sync none or let only their owner open them. The
    # file is there in any case: at worst a power failure brings back the one before.
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
