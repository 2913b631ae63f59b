"""The time page: simulated time as a file in memory, for processes that only read it.

`gaitd sim` writes it at each advance, beside its socket (SOCKET.time). The gateway, the
demonstration, the tests and a computing core read it. Cells of 64 bit, little-endian:

    0  magic        "GAITDTP1"; the last character is the version
    1  now_ns       simulated time, monotonic
    2  utc_ahead_ns simulated UTC less simulated time
    3  pace         thousandths of real time; 0: as fast as it can
    4  wall_clock   1: time is the computer's monotonic clock
    5  pid          of the process that writes
    6  wall_ns      the computer's monotonic clock when now_ns was written

It is read and written as a whole, by `pread` and `pwrite`: if another program truncates a mapped
file, its readers end with SIGBUS. The cells lie within 64 bytes, which the kernel copies by words
at least, so a reader never sees half a number. A page that was truncated or overwritten is valid
again at the next advance; until then a reader uses the values that it read last.

The file outlives its writer. While no writer lives, time continues by the computer's clock from its
last value: a reader's ages keep growing, and a later writer begins there.
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
"""Time without an advance after which a reader checks whether the writer is alive."""
_LAYOUT: Final = struct.Struct("<8s6q")
_NAME: Final = MAGIC[:-1]
_NO_PROCESS: Final = 2**31 - 1
"""Above every process id."""


class PageError(Exception):
    """The file is no time page; the message names the file and the error."""


class _Cells(NamedTuple):
    now_ns: int
    utc_ahead_ns: int
    pace_thousandths: int
    wall_clock: int
    pid: int
    wall_ns: int


def page_path(socket_path: Path) -> Path:
    """Return the path of a server's page."""
    return socket_path.with_name(socket_path.name + SUFFIX)


class PageWriter:
    """The server's side of the page."""

    def __init__(self, path: Path) -> None:
        """Open the page; create it if there is none.

        Raises:
            OSError: it cannot be created or written, or it is another kind of file.
        """
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        weakref.finalize(self, os.close, self._file)
        data = os.pread(self._file, _LAYOUT.size, 0)
        if data and not data.startswith(_NAME):
            raise FileExistsError(None, f"{path} is no time page, and is not changed")
        self._now_ns = self._utc_ahead_ns = self._pace_thousandths = 0
        self._wall_clock, self._pid = False, _NO_PROCESS
        self.left_ns: int = 0
        """The present time, continued from an earlier server; 0 if there was none."""
        if data.startswith(MAGIC) and len(data) == _LAYOUT.size:
            left = _Cells._make(_LAYOUT.unpack(data)[1:])
            self.left_ns = left.now_ns + max(time.monotonic_ns() - left.wall_ns, 0)

    def begin(self, now_ns: int, utc_ahead_ns: int, *, wall_clock: bool) -> None:
        """Mark this process as the writer."""
        self._utc_ahead_ns, self._wall_clock, self._pid = utc_ahead_ns, wall_clock, os.getpid()
        self.write(now_ns)

    def write(self, now_ns: int) -> None:
        """Write the advanced time."""
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
        """Mark the page as having no writer."""
        self._pid = _NO_PROCESS
        self.write(self._now_ns)

    def write_pace(self, pace_ratio: float) -> None:
        """Write the intended pace; 0: as fast as it can."""
        self._pace_thousandths = round(pace_ratio * 1000)
        self.write(self._now_ns)


class SimulatedTime:
    """The reader's side: a `Clock` that cannot wait, monotonic over every change of the server."""

    def __init__(self, path: Path) -> None:
        """Open the page.

        Raises:
            FileNotFoundError: there is none.
            PageError: it is no page, or of another version.
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
        self._returned_ns = 0
        self._read_ns = self._cells.now_ns
        self._read_wall_ns = time.monotonic_ns()

    @property
    def pace_ratio(self) -> float:
        """The intended pace of time; 0: as fast as it can."""
        return self._read().pace_thousandths / 1000

    @property
    def is_wall_clock(self) -> bool:
        """True if time is the computer's monotonic clock."""
        return bool(self._read().wall_clock)

    def now_ns(self) -> int:
        """Simulated time."""
        wall_ns = time.monotonic_ns()
        cells = self._read()
        if cells.wall_clock:
            return wall_ns
        now_ns = cells.now_ns
        if now_ns != self._read_ns:
            self._read_ns, self._read_wall_ns = now_ns, wall_ns
        elif wall_ns - self._read_wall_ns > ALIVE_CHECK_NS and not _lives(cells.pid):
            now_ns += wall_ns - cells.wall_ns
        self._returned_ns = max(self._returned_ns, now_ns)
        return self._returned_ns

    def utc_ns(self) -> int:
        """Simulated UTC."""
        return time.time_ns() if self.is_wall_clock else self.now_ns() + self.utc_ahead_ns()

    def utc_ahead_ns(self) -> int:
        """Simulated UTC less simulated time; changes only when the wall clock is set."""
        cells = self._read()
        return time.time_ns() - time.monotonic_ns() if cells.wall_clock else cells.utc_ahead_ns

    def _read(self) -> _Cells:
        data = os.pread(self._file, _LAYOUT.size, 0)
        if data != self._data and len(data) == _LAYOUT.size and data.startswith(MAGIC):
            self._data, self._cells = data, _Cells._make(_LAYOUT.unpack(data)[1:])
        return self._cells


def _lives(pid: int) -> bool:
    with contextlib.suppress(PermissionError):  # the process exists and belongs to another user
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
    return True
