"""Arrival times of frames from the kernel's timestamps, also while the wall clock is changed.

SocketCAN stamps a frame when its interrupt is served, long before a process reads it, but in wall
clock time, which NTP and operators change. Decisions are made in monotonic time. The loop therefore
reads both clocks as a pair when it sends SYNC, and again after each read of the socket; the
functions here convert a stamp to monotonic time with them. Clocks are read only by `read_clocks`.
Clock steps are not detected: two pairs bound the offset of the wall clock between them, and with it
the time of every stamp.

Rules:
1.  A frame is no answer to this SYNC if it cannot have arrived after it: it waited in the socket,
    or arrived between the last read and the SYNC. It counts as late, and is no sample.
2.  A stamp that may be before or after SYNC is classified by the order of reading: as an answer. So
    a fresh sample stays fresh as long as the wall clock moves in one direction within one window
    (a slew, or one step of any size). Forth and back within 4 ms costs one sample.
3.  A frame without a stamp (another bus than SocketCAN) is classified by the order of reading.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from daemon.system.clock import Clock
from drives.canopen.bus import Frame

ROUNDING_NS: Final = 500
"""Rounding of a stamp, which passes through a float of seconds (about 240 ns at today's date)."""
KNOWN_WITHIN_NS: Final = 100_000
"""Largest uncertainty of a published answer time.

It is exceeded when the wall clock was changed or the process was interrupted.
"""


class ClockPair(NamedTuple):
    """Readings of both clocks: the wall clock is read between two monotonic readings."""

    before_ns: int
    """Monotonic time before the wall clock was read."""
    utc_ns: int
    after_ns: int
    """Monotonic time after the wall clock was read."""

    @property
    def ahead_least_ns(self) -> int:
        """Smallest possible offset of the wall clock over the monotonic clock."""
        return self.utc_ns - self.after_ns

    @property
    def ahead_most_ns(self) -> int:
        """Largest possible offset of the wall clock over the monotonic clock."""
        return self.utc_ns - self.before_ns


class Arrival(NamedTuple):
    """Bounds of the arrival of a frame, in monotonic time."""

    earliest_ns: int
    latest_ns: int


def read_clocks(clock: Clock) -> ClockPair:
    """Read both clocks now."""
    before_ns = clock.now_ns()
    utc_ns = clock.utc_ns()
    return ClockPair(before_ns, utc_ns, clock.now_ns())


def arrival(stamp_utc_ns: int, begun: ClockPair, ended: ClockPair) -> Arrival:
    """Arrival of a frame that was read before `ended`, if it was stamped after `begun`."""
    ahead_most_ns = max(begun.ahead_most_ns, ended.ahead_most_ns)
    ahead_least_ns = min(begun.ahead_least_ns, ended.ahead_least_ns)
    return Arrival(
        stamp_utc_ns - ahead_most_ns - ROUNDING_NS, stamp_utc_ns - ahead_least_ns + ROUNDING_NS
    )


def is_before(stamp_utc_ns: int, begun: ClockPair, ended: ClockPair) -> bool:
    """True if a frame read before `ended` cannot have arrived after `begun` (rules 1 to 3).

    A stamp from before a backward step of the wall clock can lie in its future.
    """
    if stamp_utc_ns == 0:
        return False
    came = arrival(stamp_utc_ns, begun, ended)
    return came.latest_ns < begun.before_ns or came.earliest_ns > ended.after_ns


def sort_out(
    frames: Sequence[Frame], begun: ClockPair, ended: ClockPair
) -> tuple[list[Frame], list[Frame]]:
    """Split frames into possible answers to the SYNC sent after `begun`, and late ones, in order.

    Error frames are neither late nor early: they stay with the answers.
    """
    answers: list[Frame] = []
    others: list[Frame] = []
    for frame in frames:
        late = not frame.is_error and is_before(frame.time_ns, begun, ended)
        (others if late else answers).append(frame)
    return answers, others


def answered_ns(stamp_utc_ns: int, begun: ClockPair, ended: ClockPair) -> int | None:
    """Time from `begun` to an answer; None without a stamp, or if it is too uncertain."""
    if stamp_utc_ns == 0:
        return None
    came = arrival(stamp_utc_ns, begun, ended)
    if came.latest_ns - came.earliest_ns > KNOWN_WITHIN_NS:
        return None
    return max((came.earliest_ns + came.latest_ns) // 2 - begun.after_ns, 0)
