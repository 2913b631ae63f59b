"""The true efforts of virtual drives, as their own file tells them, at the SYNC of an estimate.

`gaitd sim --truth FILE` appends a row to FILE at each SYNC. This page reads the file as it grows,
for comparison only: the service has no access to it, and nothing here reaches the service. A real
trainer has no such file, and the page then shows no truth.

A row has the monotonic time of its SYNC, a message the UTC of the same SYNC. The first difference
of the two is that of this computer, on which the virtual drives run, too. Each match corrects it,
so a clock that is slewed for hours does not separate them.
"""

import os
from collections import deque
from collections.abc import Callable
from io import BufferedReader
from pathlib import Path
from typing import Final, NamedTuple

TIME: Final = "sync_mono_ns"
EFFORTS: Final = ("hip_patient_nm", "slide_patient_n")
KEPT: Final = 1024
"""Rows: a message comes some cycles after its SYNC, and time may be simulated and fast."""
TAIL_BYTES: Final = 64 * 1024
"""Length of the end that is read of a file that is long already."""
MATCH_NS: Final = 5_000_000
"""Half a cycle: two SYNCs are never taken for one."""


class TrueEfforts(NamedTuple):
    """What the virtual patient does at one SYNC."""

    hip_patient_nm: float
    slide_patient_n: float


class TruthFile:
    """Follows the file of one leg."""

    def __init__(self, path: Path, utc_ahead_ns: Callable[[], int]) -> None:
        """Start without a row.

        Args:
            path: of the file, which need not exist yet, and may be replaced by another run.
            utc_ahead_ns: UTC less monotonic time of this computer.
        """
        self.path = path
        self.trouble = ""
        """Why the file cannot be used; empty if it can, or is not there yet."""
        self._utc_ahead_ns = utc_ahead_ns
        self._file: BufferedReader | None = None
        self._columns: dict[str, int] = {}
        self._rest = b""
        self._rows: deque[tuple[int, TrueEfforts]] = deque(maxlen=KEPT)
        self._ahead_ns: int | None = None
        """UTC of a message less the time of its row; None: nothing has matched."""

    def read(self) -> None:
        """Take the rows that were written since the last call; a part of a line waits."""
        try:
            if self._is_another():
                self._open()
            if self._file is not None:
                self._take(self._file.read())
        except OSError as error:
            self.close()
            self.trouble = f"{self.path}: {(error.strerror or 'cannot be read').lower()}"

    def at(self, sample_time_ns: int) -> TrueEfforts | None:
        """Return the true efforts at the SYNC of a message; None: there is no row of it.

        Args:
            sample_time_ns: UTC of the SYNC.
        """
        ahead_ns = self._utc_ahead_ns() if self._ahead_ns is None else self._ahead_ns
        wanted_ns = sample_time_ns - ahead_ns
        for sync_ns, efforts in reversed(self._rows):
            if abs(sync_ns - wanted_ns) <= MATCH_NS:
                self._ahead_ns = sample_time_ns - sync_ns
                return efforts
        self._ahead_ns = None
        return None

    def close(self) -> None:
        """Close the file, and forget its rows."""
        if self._file is not None:
            self._file.close()
        self._file, self._rest, self._columns = None, b"", {}
        self._rows.clear()

    def _is_another(self) -> bool:
        """Return whether there is a file at the path that is not the open one, or begins anew."""
        if not self.path.exists():
            return False
        if self._file is None:
            return True
        now, opened = self.path.stat(), os.fstat(self._file.fileno())
        return now.st_ino != opened.st_ino or now.st_size < self._file.tell()

    def _open(self) -> None:
        self.close()
        self._file = self.path.open("rb")
        names = self._file.readline()
        if not names.endswith(b"\n"):  # it is being made
            self.close()
            return
        columns = names.decode("utf-8", "replace").strip().split(",")
        self._columns = {name: at for at, name in enumerate(columns)}
        missing = {TIME, *EFFORTS} - self._columns.keys()
        self.trouble = f"{self.path}: no column {', '.join(sorted(missing))}" if missing else ""
        size = os.fstat(self._file.fileno()).st_size
        if size - self._file.tell() > TAIL_BYTES:
            self._file.seek(size - TAIL_BYTES)
            self._file.readline()  # a part of a line

    def _take(self, data: bytes) -> None:
        *lines, self._rest = (self._rest + data).split(b"\n")
        if self.trouble:
            return
        for line in lines:
            cells = line.split(b",")
            try:
                hip_nm, slide_n = (float(cells[self._columns[name]]) for name in EFFORTS)
                sync_ns = int(cells[self._columns[TIME]])
            except (ValueError, IndexError):
                self.trouble = f"{self.path}: a row without numbers: {line[:80]!r}"
                return
            self._rows.append((sync_ns, TrueEfforts(hip_nm, slide_n)))
