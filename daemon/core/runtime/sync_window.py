"""One SYNC and the answers of the drives, received until all are complete or the window closes.

Rules:
1. Frames that wait in the socket arrived before this SYNC and are no answer to it, and neither are
   frames that arrived between that read and the SYNC, by their stamps (`arrivals.py`). Both count
   as late.
2. The window closes early once every cyclic TPDO has been received. After an incomplete window the
   next one is used in full: its first frame may be the late answer.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from daemon.core.runtime.arrivals import ClockPair, answered_ns, read_clocks, sort_out
from daemon.core.runtime.bus_link import Line
from daemon.system.clock import Clock
from drives.canopen.bus import Frame
from drives.canopen.nmt import heartbeat_frame
from drives.cia402.drive import DriveGroup


class Answers(NamedTuple):
    """Frames that answer a SYNC."""

    frames: Sequence[Frame]
    answer_ns: int
    """Time from SYNC to the last answer, by the kernel's stamps; 0 if not known."""


NO_ANSWERS: Final = Answers((), 0)


class Window:
    """The receive window of the loop after each SYNC."""

    def __init__(
        self,
        line: Line,
        clock: Clock,
        window_ns: int,
        heartbeat_cycles: int,
        master_node_id: int,
    ) -> None:
        self._line = line
        self._clock = clock
        self._window_ns = window_ns
        self._heartbeat_cycles = heartbeat_cycles
        self._heartbeat = heartbeat_frame(master_node_id)
        self._sync_count = 0
        self._was_complete = False

    def reset(self) -> None:
        """Forget the previous window, after a new bring-up."""
        self._was_complete = False

    def collect(self, drives: DriveGroup, sync_ns: int) -> Answers:
        """Send SYNC and receive answers; with the master's heartbeat, if it is due.

        Args:
            drives: told of late frames.
            sync_ns: begin of the window, monotonic.

        Raises:
            BusError: the bus is down.
        """
        drives.feed_between(self._line.drain(), sync_ns)
        if self._line.is_off:
            return NO_ANSWERS
        self._sync_count += 1
        is_due = self._sync_count % self._heartbeat_cycles == 0
        sync = [self._line.sync.frame(), *([self._heartbeat] if is_due else [])]
        begun = read_clocks(self._clock)
        self._line.send(sync)
        missing = set(drives.cyclic_ids)
        frames: list[Frame] = []
        last: tuple[Frame, ClockPair] | None = None
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
                    last = frame, now
            if not came or now.after_ns >= window_end_ns:
                break
        self._was_complete = not missing
        answer_ns = None if last is None else answered_ns(last[0].time_ns, begun, last[1])
        return Answers(frames, answer_ns or 0)
