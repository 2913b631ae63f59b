"""The clocks of the service; all other code receives the time as an argument.

Monotonic time orders and measures; UTC is for records only and is never used in a decision.
"""

import time
from typing import Protocol


class AgeClock(Protocol):
    """Clock for ages, without sleeping; simulated time where the bus is simulated."""

    def now_ns(self) -> int:
        """Monotonic time in ns."""
        ...

    def utc_ns(self) -> int:
        """Wall clock in ns since 1970, for records."""
        ...


class Clock(AgeClock, Protocol):
    """Clock for the loops of core and gateway."""

    @property
    def is_simulated(self) -> bool:
        """True while its time is simulated: for records, and for the priority of the process."""
        ...

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until an absolute monotonic time; return at once if it has passed."""
        ...


class MonotonicClock:
    """The computer's clocks."""

    is_simulated = False

    def now_ns(self) -> int:
        """Monotonic time in ns."""
        return time.monotonic_ns()

    def utc_ns(self) -> int:
        """Wall clock in ns since 1970, for records."""
        return time.time_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until an absolute monotonic time; return at once if it has passed."""
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)
