"""Sides of a comparison in fresh processes of their own: how fast they are, what memory they take."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol, Self

GRACE = 60.0  # s, for a side to end its processes


class Side(Protocol):
    """One of two things that are compared."""

    def step(self) -> int:
        """Does a measurement's worth of work and returns its frames."""

    def close(self) -> None:
        """Ends whatever was started."""


class Worker:
    """A side in a process of its own, which imports nothing that the side does not need.

    Args:
        make: builds the side there; must be importable.
        arguments: what it is called with.

    Raises:
        ModuleNotFoundError: if a package is missing that the side needs.
    """

    def __init__(self, make: Callable[..., Side], *arguments: Any) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, make, arguments))
        self._process.start()
        theirs.close()
        self._receive()

    def rate(self) -> float:
        """Frames a second over one measurement."""
        self._connection.send(True)
        return self._receive()

    def peak_memory(self) -> float:
        """Most memory (GB) that the process and all below it take up during two measurements.

        Memory that processes share counts once (proportional set size).
        """
        peak = 0
        for _ in range(2):
            self._connection.send(True)
            pause = 0.0
            while not self._connection.poll(pause):
                started = time.perf_counter()
                peak = max(peak, _tree_memory(self._process.pid))
                # Looking takes the processes' time, so most of it must be left to them.
                pause = max(0.02, 2 * (time.perf_counter() - started))
            self._receive()
        return peak / 1e9

    def close(self) -> None:
        if self._process.is_alive():
            self._connection.send(False)
            self._process.join(GRACE)
            self._process.terminate()
            self._process.join()
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _receive(self) -> Any:
        try:
            answer = self._connection.recv()
        except EOFError:
            raise RuntimeError("a process that was measured died; see above") from None
        if isinstance(answer, ModuleNotFoundError):
            raise answer
        return answer


def can_measure_memory() -> bool:
    """Whether the kernel says what processes take up; Linux does."""
    return Path("/proc/self/smaps_rollup").is_file()


def _serve(connection: Connection, make: Callable[..., Side], arguments: tuple) -> None:
    """Builds a side and answers each ``True`` with the frames a second of one measurement."""
    try:
        side = make(*arguments)
    except ModuleNotFoundError as error:
        connection.send(error)
        return
    connection.send(None)
    try:
        while connection.recv():
            started = time.perf_counter()
            frames = side.step()
            connection.send(frames / (time.perf_counter() - started))
    except EOFError:  # whoever asked is gone
        pass
    finally:
        side.close()


def _tree_memory(root: int) -> int:
    """Proportional set size (bytes) of a process and all its descendants, from Linux's /proc."""
    children: dict[int, list[int]] = {}
    for entry in os.scandir("/proc"):
        if entry.name.isdigit():
            fields = _read(Path(entry, "stat")).rpartition(")")[2].split()
            if fields:
                children.setdefault(int(fields[1]), []).append(int(entry.name))
    total = 0
    waiting = [root]
    while waiting:
        process = waiting.pop()
        waiting += children.get(process, [])
        for line in _read(Path("/proc", str(process), "smaps_rollup")).splitlines():
            if line.startswith("Pss:"):
                total += 1024 * int(line.split()[1])
    return total


def _read(path: Path) -> str:
    """A file of a process, empty if that has ended."""
    try:
        return path.read_text()
    except (FileNotFoundError, ProcessLookupError):
        return ""
