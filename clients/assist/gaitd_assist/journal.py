"""The log of the controller: JSON lines in a file, written outside of the control loop."""

from collections import deque
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import msgspec

from gaitd_assist.leg import StrideLine

LINES_KEPT: Final = 1024
"""Lines that may wait for the disk; more are lost and counted."""


class Journal:
    """Appends lines to a file; use it as a context manager.

    `add` is called by the control loop and never waits; `write` by the program's main thread.
    """

    def __init__(self, path: Path) -> None:
        """Choose the file; it is opened by `with`."""
        self._path = path
        self._waiting: deque[StrideLine] = deque(maxlen=LINES_KEPT)
        self.lost_count = 0
        """Lines that were lost because the disk was too slow."""

    def __enter__(self) -> Self:
        """Open the file.

        Raises:
            OSError: it cannot be written.
        """
        self._file = self._path.open("ab", buffering=0)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Write what waits, and close the file."""
        try:
            self.write()
        finally:
            self._file.close()

    def add(self, line: StrideLine) -> None:
        """Append a line soon."""
        self.lost_count += len(self._waiting) == LINES_KEPT
        self._waiting.append(line)

    def write(self) -> list[StrideLine]:
        """Write all lines that wait, and return them.

        Raises:
            OSError: they cannot be written.
        """
        lines: list[StrideLine] = []
        try:
            while self._waiting:
                lines.append(self._waiting.popleft())
                self._file.write(msgspec.json.encode(lines[-1]) + b"\n")
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from error
        return lines
