"""The access of a node's protocol parts to the bus and to the simulated time."""

from collections.abc import Callable
from typing import Protocol

from drives.canopen.frame import Frame


class Line(Protocol):
    """Bus and time interface of every part of a node."""

    @property
    def now_ns(self) -> int:
        """The world's time."""
        ...

    def send(self, frame: Frame, *, delay_ns: int = 0) -> None:
        """Put a frame on the bus, now or after a delay."""
        ...


class GatedLine:
    """A line that carries frames only while open, for services that some NMT states lack."""

    def __init__(self, line: Line, is_open: Callable[[], bool]) -> None:
        self._line = line
        self._is_open = is_open

    @property
    def now_ns(self) -> int:
        """The world's time."""
        return self._line.now_ns

    def send(self, frame: Frame, *, delay_ns: int = 0) -> None:
        """Put a frame on the bus, or drop it while the line is closed."""
        if self._is_open():
            self._line.send(frame, delay_ns=delay_ns)
