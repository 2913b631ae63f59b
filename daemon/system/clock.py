"""The clocks of the service; all other code receives the time as an argument.

Monotonic time orders and measures; UTC is for records only and is never used in a decision.
"""

import contextlib
import time
from pathlib import Path
from typing import Final, Protocol

from simtime.link import Link, LinkLostError
from simtime.page import PageError, SimulatedTime, page_path


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

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until an absolute monotonic time; return at once if it has passed."""
        ...


PAGE_RETRY_NS: Final = 100_000_000


class MonotonicClock:
    """The computer's clocks."""

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


class SimulatedClock:
    """Simulated time over a link; sleeping lets simulated time pass (`simtime`)."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def now_ns(self) -> int:
        """Simulated time in ns."""
        return self._link.now_ns()

    def utc_ns(self) -> int:
        """Simulated UTC in ns since 1970."""
        return self._link.utc_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Let time pass; without a server sleep by the computer's clock, as the bus is lost."""
        with contextlib.suppress(LinkLostError):
            self._link.wait(deadline_ns, for_frame=False)
            return
        time.sleep(max(deadline_ns - self._link.now_ns(), 0) * 1e-9)


class PageClock:
    """Simulated time for a process without a seat, read from the time page of the server.

    Without a server it is the computer's time. It never goes back.
    """

    def __init__(self, socket_path: Path) -> None:
        """Set the server's socket; its page is opened once it exists."""
        self._path = page_path(socket_path)
        self._page: SimulatedTime | None = None
        self._retry_ns = 0
        self._returned_ns = 0

    def now_ns(self) -> int:
        """Simulated time in ns."""
        page = self._existing()
        self._returned_ns = max(self._returned_ns, page.now_ns() if page else time.monotonic_ns())
        return self._returned_ns

    def utc_ns(self) -> int:
        """Simulated UTC in ns since 1970."""
        page = self._existing()
        return page.utc_ns() if page else time.time_ns()

    def utc_ahead_ns(self) -> int:
        """Simulated UTC minus simulated time, in ns."""
        page = self._existing()
        return page.utc_ahead_ns() if page else time.time_ns() - time.monotonic_ns()

    def _existing(self) -> SimulatedTime | None:
        wall_ns = time.monotonic_ns()
        if self._page is None and wall_ns >= self._retry_ns:
            self._retry_ns = wall_ns + PAGE_RETRY_NS
            with contextlib.suppress(OSError, PageError):  # the core reports what is wrong with it
                self._page = SimulatedTime(self._path)
        return self._page
