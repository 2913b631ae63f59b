"""The time page: simulated time as a file in memory, for those who only read it.

`gaitd sim` writes it at each advance, beside its socket (SOCKET.time). The gateway, the
demonstration, the tests and a core that computes read it. Cells of 64 bit, little-endian:

    0  magic        "GAITDTP1"
    1  now_ns       simulated time, monotonic
    2  utc_ahead_ns simulated UTC less simulated time
    3  pace         thousandths of real time; 0: as fast as it can
    4  wall_clock   1: time is the computer's monotonic clock
    5  pid          of the process that writes
    6  wall_ns      the computer's monotonic clock when now_ns was written

Each cell is one aligned store, so a reader never sees half a number. The file outlives its writer.
While no writer lives, time goes on by the computer's clock from where it was left: a reader's ages
go on growing, and a later writer begins there.
"""

import contextlib
import mmap
import os
import time
from pathlib import Path
from typing import Final

PAGE_SIZE: Final = 4096
MAGIC: Final = int.from_bytes(b"GAITDTP1", "little")
SUFFIX: Final = ".time"
ALIVE_CHECK_NS: Final = 200_000_000
"""A time that stands still for longer makes a reader look whether its writer lives."""
_MAGIC, _NOW, _UTC_AHEAD, _PACE, _WALL_CLOCK, _PID, _WALL = range(7)
_NO_PROCESS: Final = 2**31 - 1
"""Beyond every process id."""


class PageError(Exception):
    """The file is no time page: names it and what is wrong."""


def page_path(socket_path: Path) -> Path:
    """Where the page of a server lies."""
    return socket_path.with_name(socket_path.name + SUFFIX)


def _cells(path: Path, *, write: bool) -> "memoryview[int]":
    with path.open("r+b" if write else "rb") as file:
        if os.fstat(file.fileno()).st_size < PAGE_SIZE:
            raise PageError(f"{path}: is shorter than {PAGE_SIZE} bytes, no time page")
        access = mmap.ACCESS_WRITE if write else mmap.ACCESS_READ
        return memoryview(mmap.mmap(file.fileno(), PAGE_SIZE, access=access)).cast("q")


class PageWriter:
    """The server's end."""

    def __init__(self, path: Path) -> None:
        """Map the page; make it if there is none.

        Raises:
            OSError: it cannot be made or written.
        """
        if not path.exists() or path.stat().st_size != PAGE_SIZE:
            temporary = path.with_name(path.name + ".new")
            temporary.write_bytes(bytes(PAGE_SIZE))
            temporary.replace(path)
        self._cells = _cells(path, write=True)
        is_page = self._cells[_MAGIC] == MAGIC
        since_ns = max(time.monotonic_ns() - self._cells[_WALL], 0)
        self.left_ns: int = self._cells[_NOW] + since_ns if is_page else 0
        """The time by now, behind an earlier server; 0 where there was none."""

    def begin(self, now_ns: int, utc_ahead_ns: int, *, wall_clock: bool) -> None:
        """Say that we write from now on."""
        self.write(now_ns)
        self._cells[_UTC_AHEAD] = utc_ahead_ns
        self._cells[_WALL_CLOCK] = wall_clock
        self._cells[_PID] = os.getpid()
        self._cells[_MAGIC] = MAGIC

    def write(self, now_ns: int) -> None:
        """Time has passed."""
        self._cells[_NOW] = now_ns
        self._cells[_WALL] = time.monotonic_ns()

    def leave(self) -> None:
        """Say that we write no more."""
        self._cells[_PID] = _NO_PROCESS

    def write_pace(self, pace_ratio: float) -> None:
        """How fast time is meant to pass; 0: as fast as it can."""
        self._cells[_PACE] = round(pace_ratio * 1000)


class SimulatedTime:
    """A reader's end: a `Clock` that cannot wait, monotonic over every change of the server."""

    def __init__(self, path: Path) -> None:
        """Map the page.

        Raises:
            FileNotFoundError: there is none.
            PageError: it is none.
        """
        self._cells = _cells(path, write=False)
        if self._cells[_MAGIC] != MAGIC:
            raise PageError(f"{path}: does not begin as a time page does")
        self._told_ns = 0
        self._seen_ns = self._cells[_NOW]
        self._seen_wall_ns = time.monotonic_ns()

    @property
    def pace_ratio(self) -> float:
        """How fast time is meant to pass; 0: as fast as it can."""
        return self._cells[_PACE] / 1000

    @property
    def is_wall_clock(self) -> bool:
        """Time is the computer's monotonic clock."""
        return bool(self._cells[_WALL_CLOCK])

    def now_ns(self) -> int:
        """Simulated time."""
        wall_ns = time.monotonic_ns()
        if self._cells[_WALL_CLOCK]:
            return wall_ns
        now_ns = self._cells[_NOW]
        if now_ns != self._seen_ns:
            self._seen_ns, self._seen_wall_ns = now_ns, wall_ns
        elif wall_ns - self._seen_wall_ns > ALIVE_CHECK_NS and not self._writer_lives():
            now_ns += wall_ns - self._cells[_WALL]
        self._told_ns = max(self._told_ns, now_ns)
        return self._told_ns

    def utc_ns(self) -> int:
        """Simulated UTC."""
        return time.time_ns() if self.is_wall_clock else self.now_ns() + self.utc_ahead_ns()

    def utc_ahead_ns(self) -> int:
        """Simulated UTC less simulated time; constant but for a wall clock that is set."""
        if self.is_wall_clock:
            return time.time_ns() - time.monotonic_ns()
        return self._cells[_UTC_AHEAD]

    def _writer_lives(self) -> bool:
        with contextlib.suppress(PermissionError):  # of another user, and there
            try:
                os.kill(self._cells[_PID], 0)
            except ProcessLookupError:
                return False
        return True
