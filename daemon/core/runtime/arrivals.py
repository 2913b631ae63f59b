"""When frames came, by the kernel's stamps, also while somebody sets the wall clock.

SocketCAN stamps a frame when its interrupt was served, long before a process reads it, but in wall
clock time, which NTP and operators move. Decisions are made in monotonic time. The loop therefore
reads both clocks as a pair when it sends SYNC, and again after each look into the socket, and asks
here what a stamp can mean. No clock is read in this file but by `read_clocks`, and no step is ever
looked for: two pairs bound what the wall clock was ahead by in between, and with it every stamp.

Rules:
1.  A frame is no answer to this SYNC if it cannot have come after it: it waited in the socket, or
    came between the last look and the SYNC. It counts as late, and is no sample.
2.  A stamp that can be of either side is taken as the order of reading says: as an answer. So a
    fresh sample stays one whatever the wall clock does, as long as it moves one way within one
    window (a slew, or one step of any size). Forth and back within 4 ms costs one sample.
3.  A frame without a stamp (another bus than SocketCAN) is taken as the order of reading says.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from daemon.system.clock import Clock
from drives.canopen.bus import Frame

ROUNDING_NS: Final = 500
"""A stamp passes through a float of seconds, which holds about 240 ns at today's date."""
KNOWN_WITHIN_NS: Final = 100_000
"""An arrival that is known less well is not told: the wall clock moved, or we were interrupted."""


class ClockPair(NamedTuple):
    """Both clocks at one moment: the wall clock was read between two reads of the other."""

    before_ns: int
    """Monotonic."""
    utc_ns: int
    after_ns: int
    """Monotonic."""

    @property
    def ahead_least_ns(self) -> int:
        """What the wall clock is ahead of the monotonic one by, at least."""
        return self.utc_ns - self.after_ns

    @property
    def ahead_most_ns(self) -> int:
        """And at most."""
        return self.utc_ns - self.before_ns


class Arrival(NamedTuple):
    """A frame came between these two, in monotonic time."""

    earliest_ns: int
    latest_ns: int


def read_clocks(clock: Clock) -> ClockPair:
    """Both clocks now."""
    before_ns = clock.now_ns()
    utc_ns = clock.utc_ns()
    return ClockPair(before_ns, utc_ns, clock.now_ns())


def arrival(stamp_utc_ns: int, begun: ClockPair, ended: ClockPair) -> Arrival:
    """When a frame came that was read before `ended`, if it was stamped after `begun`."""
    ahead_most_ns = max(begun.ahead_most_ns, ended.ahead_most_ns)
    ahead_least_ns = min(begun.ahead_least_ns, ended.ahead_least_ns)
    return Arrival(
        stamp_utc_ns - ahead_most_ns - ROUNDING_NS, stamp_utc_ns - ahead_least_ns + ROUNDING_NS
    )


def is_before(stamp_utc_ns: int, begun: ClockPair, ended: ClockPair) -> bool:
    """Whether a frame read before `ended` cannot have come after `begun` (rules 1 to 3).

    A stamp of the time before a step backwards can lie in the future of today's wall clock.
    """
    if stamp_utc_ns == 0:
        return False
    came = arrival(stamp_utc_ns, begun, ended)
    return came.latest_ns < begun.before_ns or came.earliest_ns > ended.after_ns


def sort_out(
    frames: Sequence[Frame], begun: ClockPair, ended: ClockPair
) -> tuple[list[Frame], list[Frame]]:
    """What may be an answer to the SYNC sent after `begun`, and what cannot, each in order.

    Error frames are neither late nor early: they stay with the answers.
    """
    answers: list[Frame] = []
    others: list[Frame] = []
    for frame in frames:
        late = not frame.is_error and is_before(frame.time_ns, begun, ended)
        (others if late else answers).append(frame)
    return answers, others


def answered_ns(stamp_utc_ns: int, begun: ClockPair, ended: ClockPair) -> int | None:
    """How long after `begun` an answer came; None where its stamp does not say that well enough."""
    if stamp_utc_ns == 0:
        return None
    came = arrival(stamp_utc_ns, begun, ended)
    if came.latest_ns - came.earliest_ns > KNOWN_WITHIN_NS:
        return None
    return max((came.earliest_ns + came.latest_ns) // 2 - begun.after_ns, 0)
