"""The time grid of cycles: absolute points in time, of which missed ones are skipped.

Rules:
1. Missed grid points are skipped and counted, never caught up in a burst.
2. One that is late by more than LATE_MAX_NS is missed: its SYNC would come too close to the next.
3. Each miss is attributed to the part of the cycle that exceeded its time the most.
"""

from typing import Final

from gaitd_names import CyclePart
from msgspec.structs import replace

from daemon.ipc.cycle_timing import CycleTiming
from daemon.system.clock import Clock

LATE_MAX_NS: Final = 3_000_000
"""Largest lateness of a cycle: two SYNCs are never closer than the period less this."""


def longest_part(timing: CycleTiming, window_ns: int) -> CyclePart:
    """The part of a cycle to which a missed grid point is attributed."""
    beyond_ns = {
        CyclePart.WAKE_UP: timing.lateness_ns,
        CyclePart.WINDOW: timing.collect_ns - window_ns,
        CyclePart.WORK: timing.work_ns,
        CyclePart.PUBLISH: timing.publish_ns,
    }
    return max(beyond_ns, key=lambda part: beyond_ns[part])


def count_missed(timing: CycleTiming, missed: int, part: CyclePart) -> CycleTiming:
    """The timing with more missed grid points, attributed to a part of the cycle."""
    before = timing.overrun_by_part
    by_part = {**before, part: before.get(part, 0) + missed}
    return replace(timing, overrun_count=sum(by_part.values()), overrun_by_part=by_part)


class Grid:
    """The present grid point of the loop, and the number of missed ones directly before it."""

    def __init__(self, clock: Clock, period_ns: int) -> None:
        self._clock = clock
        self.period_ns = period_ns
        self.due_ns = clock.now_ns() + period_ns
        """The next grid point; monotonic time."""
        self.cycle = 0
        """Number of that grid point."""
        self.missed_in_a_row = 0

    @property
    def end_ns(self) -> int:
        """The grid point after the next: the end of the cycle that is due."""
        return self.due_ns + self.period_ns

    @property
    def next_cycle(self) -> int:
        """Number of the next grid point that can be met, which is a later one after a delay."""
        return self.cycle + self._missed()

    def advance(self) -> int:
        """Advance to the next grid point that can be met; returns the number of missed ones."""
        self.due_ns += self.period_ns
        self.cycle += 1
        missed = self.skip_missed()
        if missed == 0:
            self.missed_in_a_row = 0
        return missed

    def skip_missed(self) -> int:
        """Skip and count missed grid points; returns their number."""
        missed = self._missed()
        self._jump(missed)
        self.missed_in_a_row += missed
        return missed

    def _missed(self) -> int:
        late_ns = self._clock.now_ns() - self.due_ns
        return late_ns // self.period_ns + 1 if late_ns > LATE_MAX_NS else 0

    def jump(self) -> None:
        """Move to the next grid point from now, without counting misses."""
        late_ns = max(self._clock.now_ns() - self.due_ns, 0)
        self._jump(late_ns // self.period_ns + 1)

    def _jump(self, points: int) -> None:
        self.due_ns += points * self.period_ns
        self.cycle += points
