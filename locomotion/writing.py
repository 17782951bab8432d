"""Files that are written whole or not at all."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: Errors of a file system that cannot sync.
_NO_SYNC = {errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EBADF}


@contextmanager
def replacing(target: Path) -> Iterator[Path]:
    """A name to write to in place of ``target``, which it becomes when the block ends.

    The name has the ending of ``target``. A block that raises leaves ``target`` as it was. What was
    written is on the disk before it takes its place, so that it survives a power failure too, where
    the file system can promise that.
    """
    partial = target.with_name(f".partial-{target.name}")
    try:
        yield partial
        _sync(partial)
        partial.replace(target)
        _sync(target.parent)
    finally:
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


def _sync(path: Path) -> None:
    # Windows syncs files that are open for writing alone, and no folders.
    if path.is_dir() and os.name != "posix":
        return
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        sync(descriptor)
    finally:
        os.close(descriptor)
