"""One SYNC and what the drives answer: listened to until all is there, or the window closes.

Rules:
1. What waits in the socket came before this SYNC: it is not an answer to it. Nor is what came
   between that look and the SYNC, as its stamp says (`arrivals.py`). Both count as late.
2. The window closes early once every cyclic TPDO has come. After an incomplete window the whole of
   the next one is waited for: what comes first may be the answer that was late.
"""

from collections.abc import Sequence

from daemon.core.runtime.arrivals import answered_ns, read_clocks, sort_out
from daemon.core.runtime.bus_link import Line
from daemon.system.clock import Clock
from drives.canopen.bus import Frame
from drives.cia402.drive import DriveGroup


class Window:
    """The windows of one loop, one after the other."""

    def __init__(self, line: Line, clock: Clock, window_ns: int) -> None:
        self._line = line
        self._clock = clock
        self._window_ns = window_ns
        self._was_complete = False
        self.answer_ns = 0
        """From SYNC to the last answer, by the kernel's stamps; 0 where nobody knows."""

    def begin(self) -> None:
        """A cycle begins: nobody has answered."""
        self.answer_ns = 0

    def forget(self) -> None:
        """The drives were brought up anew: nothing is known of the window before."""
        self._was_complete = False

    def collect(self, drives: DriveGroup, sync: Sequence[Frame], sync_ns: int) -> list[Frame]:
        """Send SYNC and listen; `sync_ns` is the time from which the window counts.

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
