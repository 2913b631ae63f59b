"""Clocks of a client: that for measuring silence is injected, so it can follow simulated time."""

import time
from typing import Protocol


class Clock(Protocol):
    """Anything with the monotonic time in ns, for example `virtual_trainer.clock` in tests."""

    def now_ns(self) -> int:
        """Monotonic time in ns."""
        ...


class MonotonicClock:
    """The computer's clock."""

    def now_ns(self) -> int:
        """Monotonic time in ns."""
        return time.monotonic_ns()


class UtcClock:
    """The computer's time of day: for records only, because it jumps when it is set."""

    def now_ns(self) -> int:
        """UTC in ns since 1970."""
        return time.time_ns()
