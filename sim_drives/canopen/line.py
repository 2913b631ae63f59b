"""A node's end of the bus, and the node's time: all that its protocol parts see of the world."""

from collections.abc import Callable
from typing import Protocol

from sim_drives.frame import Frame


class Line(Protocol):
    """Handed to every part of a node that sends, or that needs to know what time it is."""

    @property
    def now_ns(self) -> int:
        """The world's time."""
        ...

    def send(self, frame: Frame, *, delay_ns: int = 0) -> None:
        """Put a frame on the bus, now or a little later."""
        ...


class GatedLine:
    """A line that carries frames only while it is open: a service that not every state has."""

    def __init__(self, line: Line, is_open: Callable[[], bool]) -> None:
        self._line = line
        self._is_open = is_open

    @property
    def now_ns(self) -> int:
        """The world's time."""
        return self._line.now_ns

    def send(self, frame: Frame, *, delay_ns: int = 0) -> None:
        """Put a frame on the bus, or forget it."""
        if self._is_open():
            self._line.send(frame, delay_ns=delay_ns)
