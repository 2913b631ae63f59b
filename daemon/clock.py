"""The clocks of the service. Everything else is handed the time as an argument.

Monotonic time orders and measures; UTC is for records only and never enters a decision.
"""

import contextlib
import time
from typing import Protocol

from simtime.link import Link, LinkLostError


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


class SimulatedClock:
    """Simulated time over a link: sleeping lets it pass (`simtime`)."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def now_ns(self) -> int:
        """Simulated time in ns."""
        return self._link.now_ns()

    def utc_ns(self) -> int:
        """Simulated UTC in ns since 1970."""
        return self._link.utc_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Let time pass; without a server it is the computer's, and the bus says that it is lost."""
        with contextlib.suppress(LinkLostError):
            self._link.check()
            self._link.wait(deadline_ns, for_frame=False)
            return
        time.sleep(max(deadline_ns - self._link.now_ns(), 0) * 1e-9)
