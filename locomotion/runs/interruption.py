"""Stopping when asked to, but not in the middle of something."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from types import FrameType, TracebackType
from typing import Any, Self


class StopRequest:
    """Notes the first Ctrl-C, or SIGTERM, which the code inside looks out for; a second one ends it.

    Attributes:
        received: whether there was one.
    """

    def __init__(self) -> None:
        self.received = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        # Only the main thread may; a launcher may run jobs in others, which it ends by itself.
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.received:
            raise KeyboardInterrupt
        self.received = True
        # Not with print, which may be in the middle of writing something else. Nobody may read it:
        # Ctrl-C ends what a pipe leads to, too.
        with contextlib.suppress(OSError):
            os.write(2, b"\nstopping after this iteration; once more stops at once\n")
