"""The time page: simulated time as a file in memory, for those who only read it.

`gaitd sim` writes it at each advance, beside its socket (SOCKET.time). The gateway, the
demonstration, the tests and a core that computes read it. Cells of 64 bit, little-endian:

    0  magic        "GAITDTP1"; the last character is the version
    1  now_ns       simulated time, monotonic
    2  utc_ahead_ns simulated UTC less simulated time
    3  pace         thousandths of real time; 0: as fast as it can
    4  wall_clock   1: time is the computer's monotonic clock
    5  pid          of the process that writes
    6  wall_ns      the computer's monotonic clock when now_ns was written

It is read and written whole, by `pread` and `pwrite`: a mapped file that another program cuts short
ends who looks at it with SIGBUS. The cells lie within 64 bytes, which the kernel copies by words at
least, so a reader never sees half a number. A page that was cut short or overwritten is whole again
at the next advance; until then a reader goes by what it read last.

The file outlives its writer. While no writer lives, time goes on by the computer's clock from where
it was left: a reader's ages go on growing, and a later writer begins there.
"""

import contextlib
import os
import struct
import time
import weakref
from pathlib import Path
from typing import Final, NamedTuple

MAGIC: Final = b"GAITDTP1"
SUFFIX: Final = ".time"
ALIVE_CHECK_NS: Final = 200_000_000
"""A time that stands still for longer makes a reader look whether its writer lives."""
_LAYOUT: Final = struct.Struct("<8s6q")
_NAME: Final = MAGIC[:-1]
_NO_PROCESS: Final = 2**31 - 1
"""Beyond every process id."""


class PageError(Exception):
    """The file is no time page: names it and what is wrong."""


class _Cells(NamedTuple):
    now_ns: int
    utc_ahead_ns: int
    pace_thousandths: int
    wall_clock: int
    pid: int
    wall_ns: int


def page_path(socket_path: Path) -> Path:
    """Where the page of a server lies."""
    return socket_path.with_name(socket_path.name + SUFFIX)


class PageWriter:
    """The server's end."""

    def __init__(self, path: Path) -> None:
        """Open the page; make it if there is none.

        Raises:
            OSError: it cannot be made or written, or is a file of something else.
        """
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        weakref.finalize(self, os.close, self._file)
        data = os.pread(self._file, _LAYOUT.size, 0)
        if data and not data.startswith(_NAME):
            raise FileExistsError(None, f"{path} is no time page, and is left as it is")
        self._now_ns = self._utc_ahead_ns = self._pace_thousandths = 0
        self._wall_clock, self._pid = False, _NO_PROCESS
        self.left_ns: int = 0
        """The time by now, behind an earlier server; 0 where there was none."""
        if data.startswith(MAGIC) and len(data) == _LAYOUT.size:
            left = _Cells._make(_LAYOUT.unpack(data)[1:])
            self.left_ns = left.now_ns + max(time.monotonic_ns() - left.wall_ns, 0)

    def begin(self, now_ns: int, utc_ahead_ns: int, *, wall_clock: bool) -> None:
        """Say that we write from now on."""
        self._utc_ahead_ns, self._wall_clock, self._pid = utc_ahead_ns, wall_clock, os.getpid()
        self.write(now_ns)

    def write(self, now_ns: int) -> None:
        """Time has passed."""
        self._now_ns = now_ns
        cells = (
            now_ns,
            self._utc_ahead_ns,
            self._pace_thousandths,
            self._wall_clock,
            self._pid,
            time.monotonic_ns(),
        )
        os.pwrite(self._file, _LAYOUT.pack(MAGIC, *cells), 0)

    def leave(self) -> None:
        """Say that we write no more."""
        self._pid = _NO_PROCESS
        self.write(self._now_ns)

    def write_pace(self, pace_ratio: float) -> None:
        """How fast time is meant to pass; 0: as fast as it can."""
        self._pace_thousandths = round(pace_ratio * 1000)
        self.write(self._now_ns)


class SimulatedTime:
    """A reader's end: a `Clock` that cannot wait, monotonic over every change of the server."""

    def __init__(self, path: Path) -> None:
        """Open the page.

        Raises:
            FileNotFoundError: there is none.
            PageError: it is none, or of another version.
        """
        self._file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        weakref.finalize(self, os.close, self._file)
        data = os.pread(self._file, _LAYOUT.size, 0)
        if not data.startswith(_NAME):
            raise PageError(f"{path}: does not begin as a time page does")
        if not data.startswith(MAGIC):
            told, known = (one[-1:].decode(errors="replace") for one in (data[:8], MAGIC))
            raise PageError(f"{path}: is a time page of version {told}; this gaitd reads {known}")
        if len(data) < _LAYOUT.size:
            raise PageError(f"{path}: is cut short: {len(data)} of {_LAYOUT.size} bytes")
        self._data, self._cells = data, _Cells._make(_LAYOUT.unpack(data)[1:])
        self._told_ns = 0
        self._seen_ns = self._cells.now_ns
        self._seen_wall_ns = time.monotonic_ns()

    @property
    def pace_ratio(self) -> float:
        """How fast time is meant to pass; 0: as fast as it can."""
        return self._read().pace_thousandths / 1000

    @property
    def is_wall_clock(self) -> bool:
        """Time is the computer's monotonic clock."""
        return bool(self._read().wall_clock)

    def now_ns(self) -> int:
        """Simulated time."""
        wall_ns = time.monotonic_ns()
        cells = self._read()
        if cells.wall_clock:
            return wall_ns
        now_ns = cells.now_ns
        if now_ns != self._seen_ns:
            self._seen_ns, self._seen_wall_ns = now_ns, wall_ns
        elif wall_ns - self._seen_wall_ns > ALIVE_CHECK_NS and not _lives(cells.pid):
            now_ns += wall_ns - cells.wall_ns
        self._told_ns = max(self._told_ns, now_ns)
        return self._told_ns

    def utc_ns(self) -> int:
        """Simulated UTC."""
        return time.time_ns() if self.is_wall_clock else self.now_ns() + self.utc_ahead_ns()

    def utc_ahead_ns(self) -> int:
        """Simulated UTC less simulated time; constant but for a wall clock that is set."""
        cells = self._read()
        return time.time_ns() - time.monotonic_ns() if cells.wall_clock else cells.utc_ahead_ns

    def _read(self) -> _Cells:
        data = os.pread(self._file, _LAYOUT.size, 0)
        if data != self._data and len(data) == _LAYOUT.size and data.startswith(MAGIC):
            self._data, self._cells = data, _Cells._make(_LAYOUT.unpack(data)[1:])
        return self._cells


def _lives(pid: int) -> bool:
    with contextlib.suppress(PermissionError):  # of another user, and there
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
    return True
