"""A node's end of the bus, and the node's time: all that its protocol parts see of the world."""

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
