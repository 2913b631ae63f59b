"""Commands to the drives: sent while their cycle lasts.

Rules:
1. A command whose cycle is over is not sent late; it counts as dropped. A command that meets a full
   queue is dropped too.
2. Commands that stop a drive are sent however late, and are retried within the cycle: no newer
   command is under way, and the drives wait for them.
3. NMT stop is sent once to each drive whose stop has escalated to it.
"""

from collections.abc import Sequence
from typing import Final

from daemon.core.runtime.bus_link import Line
from daemon.system.clock import Clock
from drives.canopen.bus import Frame
from drives.canopen.nmt import NmtCommand, nmt_frame

SEND_MARGIN_NS: Final = 500_000
"""Commands are sent at the latest this long before the next SYNC."""


class Commands:
    """The commands of each cycle, and the drives that have NMT stop."""

    def __init__(self, line: Line, clock: Clock) -> None:
        self._line = line
        self._clock = clock
        self._stopped: tuple[int, ...] = ()
        """Node ids of the drives to which NMT stop has been sent."""

    def reset(self) -> None:
        """Forget which drives have NMT stop, after a new bring-up."""
        self._stopped = ()

    def send(
        self, frames: Sequence[Frame], stopped: tuple[int, ...], end_ns: int, *, urgent: bool
    ) -> None:
        """Send the commands of a cycle.

        Args:
            frames: commands of this cycle.
            stopped: node ids of the drives that are to have NMT stop.
            end_ns: end of the cycle, monotonic.
            urgent: the commands stop a drive.

        Raises:
            BusError: the bus is down.
        """
        line, deadline_ns = self._line, end_ns - SEND_MARGIN_NS
        if urgent:
            line.send_urgent(frames, deadline_ns)
        elif self._clock.now_ns() > deadline_ns:
            line.drop(frames)
        else:
            line.send(frames)
        stops = [nmt_frame(NmtCommand.STOP, node) for node in stopped if node not in self._stopped]
        if not stops or line.send_urgent(stops, deadline_ns):
            self._stopped = stopped
