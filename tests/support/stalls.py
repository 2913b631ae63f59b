"""Whether this computer stood still: a witness on each processor wakes up every 5 ms.

It notes when it came late. What its own process computes in C without a pause looks the same to it.
"""

import os
import threading
import time
from collections.abc import Iterable
from typing import Final

EVERY_NS: Final = 5_000_000
LATE_NS: Final = 10_000_000
"""A cycle of the service."""


class Stalls:
    """When this computer came late, and by how much."""

    def __init__(self) -> None:
        self.late_ns: list[int] = []
        self.last_ns = 0
        self.over = threading.Event()
        """Nobody watches any more."""

    def woke(self, due_ns: int, now_ns: int) -> None:
        """Take a wake-up that was due."""
        if now_ns - due_ns > LATE_NS:
            self.late_ns.append(now_ns - due_ns)
            self.last_ns = now_ns

    def since(self, begin: int) -> range:
        """The numbers of those from one on."""
        return range(begin, len(self.late_ns))

    def worst_ns(self, numbers: Iterable[int]) -> int:
        """The longest of these; 0 if there are none."""
        return max((self.late_ns[number] for number in numbers), default=0)

    def wait_until_calm(self, calm_s: float, patience_s: float) -> None:
        """Until there was none for a while, or all the same when patience is over."""
        end_s = time.monotonic() + patience_s
        while not self.calm(time.monotonic_ns(), calm_s) and time.monotonic() < end_s:
            time.sleep(0.1)

    def calm(self, now_ns: int, calm_s: float) -> bool:
        """Whether there was none for a while."""
        return now_ns - self.last_ns > calm_s * 1e9


def watch(stalls: Stalls) -> None:
    """A witness on each processor, until it is over."""
    for processor in os.sched_getaffinity(0):
        threading.Thread(target=_witness, args=(stalls, processor), daemon=True).start()


def _witness(stalls: Stalls, processor: int) -> None:
    os.sched_setaffinity(0, {processor})
    due_ns = time.monotonic_ns()
    while not stalls.over.is_set():
        due_ns += EVERY_NS
        time.sleep(max(due_ns - time.monotonic_ns(), 0) * 1e-9)
        now_ns = time.monotonic_ns()
        stalls.woke(due_ns, now_ns)
        due_ns = max(due_ns, now_ns - EVERY_NS)
