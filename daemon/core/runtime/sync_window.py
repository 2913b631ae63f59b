"""One SYNC and the answers of the drives, received until all are complete or the window closes.

Rules:
1. Frames that wait in the socket arrived before this SYNC and are no answer to it, and neither are
   frames that arrived between that read and the SYNC, by their stamps (`arrivals.py`). Both count
   as late.
2. The window closes early once every cyclic TPDO has been received. After an incomplete window the
   next one is used in full: its first frame may be the late answer.
"""

from collections.abc import Sequence

from daemon.core.runtime.arrivals import answered_ns, read_clocks, sort_out
from daemon.core.runtime.bus_link import Line
from daemon.system.clock import Clock
from drives.canopen.bus import Frame
from drives.cia402.drive import DriveGroup


class Window:
    """The receive window of the loop after each SYNC."""

    def __init__(self, line: Line, clock: Clock, window_ns: int) -> None:
        self._line = line
        self._clock = clock
        self._window_ns = window_ns
        self._was_complete = False
        self.answer_ns = 0
        """Time from SYNC to the last answer, by the kernel's stamps; 0 if not known."""

    def begin(self) -> None:
        """Reset the answer time at the begin of a cycle."""
        self.answer_ns = 0

    def reset(self) -> None:
        """Forget the previous window, after a new bring-up."""
        self._was_complete = False

    def collect(self, drives: DriveGroup, sync: Sequence[Frame], sync_ns: int) -> list[Frame]:
        """Send SYNC and receive answers; `sync_ns` is the begin of the window.

        Raises:
            BusError: the bus is down.
        """
        begun = read_clocks(self._clock)
        self._line.send(sync)
        missing = set(drives.cyclic_ids)
        frames: list[Frame] = []
        window_end_ns = sync_ns + self._window_ns
        while missing or not self._was_complete:
            came = self._line.receive_until(window_end_ns)
            now = read_clocks(self._clock)
            answers, others = sort_out(came, begun, now)
            drives.feed_between(others, sync_ns)
            frames += answers
            for frame in answers:
                if frame.can_id in missing:
                    missing.remove(frame.can_id)
                    self.answer_ns = answered_ns(frame.time_ns, begun, now) or 0
            if not came or now.after_ns >= window_end_ns:
                break
        self._was_complete = not missing
        return frames
