"""Clocks of programs in simulated time: that of a seat, and that of a reader of the time page."""

import contextlib
import time
from pathlib import Path
from typing import Final

from simtime.link import Link, LinkLostError
from simtime.page import PageError, SimulatedTime, page_path

PAGE_RETRY_NS: Final = 100_000_000


class SimulatedClock:
    """Simulated time over a link; sleeping lets simulated time pass (`simtime`)."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self.now_ns = link.now_ns
        """Simulated time in ns."""
        self.utc_ns = link.utc_ns
        """Simulated UTC in ns since 1970."""

    @property
    def is_simulated(self) -> bool:
        """False while the server, or its absence, lets time pass by the computer's clock."""
        return self._link.is_in_step

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
