"""Clock of a client: it measures silence, and is injected, so that it can follow simulated time."""

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
