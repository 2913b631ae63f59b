"""The only clock of the service. Everything else is handed the time as an argument.

Monotonic time orders and measures; UTC is for records only and never enters a decision.
"""

import time
from typing import Protocol


class Clock(Protocol):
    """What the loops of core and gateway need of time."""

    def now_ns(self) -> int:
        """Monotonic time in ns."""
        ...

    def utc_ns(self) -> int:
        """Wall clock in ns since 1970, for records."""
        ...

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at the absolute monotonic time, at once if it is over."""
        ...


class MonotonicClock:
    """The machine's clocks."""

    def now_ns(self) -> int:
        """Monotonic time in ns."""
        return time.monotonic_ns()

    def utc_ns(self) -> int:
        """Wall clock in ns since 1970, for records."""
        return time.time_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at the absolute monotonic time, at once if it is over."""
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)
