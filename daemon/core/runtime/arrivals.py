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


def read_clocks(clock: Clock) -> ClockPair:
    """Read both clocks now."""
    before_ns = clock.now_ns()
    utc_ns = clock.utc_ns()
    return ClockPair(before_ns, utc_ns, clock.now_ns())


def _ahead_ns(begun: ClockPair, ended: ClockPair) -> tuple[int, int]:
    """Smallest and largest offset of the wall clock over the monotonic clock between two pairs."""
    return (
        min(begun.ahead_least_ns, ended.ahead_least_ns),
        max(begun.ahead_most_ns, ended.ahead_most_ns),
    )


def sort_out(
    frames: Sequence[Frame], begun: ClockPair, ended: ClockPair
) -> tuple[list[Frame], list[Frame]]:
    """Split frames into possible answers to the SYNC sent after `begun`, and late ones, in order.

    `ended` was read after the frames (rules 1 to 3). Error frames are neither late nor early: they
    stay with the answers. A stamp from before a backward step of the wall clock can lie in its
    future.
    """
    least_ns, most_ns = _ahead_ns(begun, ended)
    first_utc_ns = begun.before_ns + least_ns - ROUNDING_NS
    last_utc_ns = ended.after_ns + most_ns + ROUNDING_NS
    answers: list[Frame] = []
    others: list[Frame] = []
    for frame in frames:
        is_possible = first_utc_ns <= frame.time_ns <= last_utc_ns
        taken = is_possible or frame.is_error or frame.time_ns == 0
        (answers if taken else others).append(frame)
    return answers, others


def answered_ns(stamp_utc_ns: int, begun: ClockPair, ended: ClockPair) -> int | None:
    """Time from `begun` to an answer; None without a stamp, or if it is too uncertain."""
    if stamp_utc_ns == 0:
        return None
    least_ns, most_ns = _ahead_ns(begun, ended)
    if most_ns - least_ns + 2 * ROUNDING_NS > KNOWN_WITHIN_NS:
        return None
    return max((2 * stamp_utc_ns - most_ns - least_ns) // 2 - begun.after_ns, 0)
