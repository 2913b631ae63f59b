"""Tests of real processes on a computer that others use as well.

A drive that is silent for 30 ms stops the leg, rightly, and nobody can tell it from a computer that
stood still for so long. So a witness on each processor wakes up every 5 ms and notes when it came
late. A test of real processes that failed while that happened has shown nothing: it is run again,
once the computer is calm, twice at most, and the summary tells of it. One that failed while nothing
stood still has failed.
"""

import os
import threading
import time
from collections.abc import Callable
from typing import Final

import pytest
from parallel import ALONE

from gaitd.testing.trainer import HELD_UP_S

EVERY_NS: Final = 5_000_000
LATE_NS: Final = 10_000_000
"""A cycle of the service."""
AGAIN_MAX: Final = 2
CALM_S: Final = 2.0
PATIENCE_S: Final = 120.0
"""For a calm computer; then the test is run again all the same."""


class Stalls:
    """When this computer came late, and by how much."""

    def __init__(self) -> None:
        self.late_ns: list[int] = []
        self.last_ns = 0

    def woke(self, due_ns: int, now_ns: int) -> None:
        """Take a wake-up that was due."""
        if now_ns - due_ns > LATE_NS:
            self.late_ns.append(now_ns - due_ns)
            self.last_ns = now_ns

    def words(self, begin: int) -> str:
        """Those from a number on."""
        late_ns = self.late_ns[begin:]
        if not late_ns:
            return ""
        return f"held up {len(late_ns)} times, {max(late_ns) / 1e6:.0f} ms at most"

    def calm(self, now_ns: int) -> bool:
        """Whether there was none for a while."""
        return now_ns - self.last_ns > CALM_S * 1e9


def watch(stalls: Stalls) -> None:
    """A witness on each processor, for as long as the tests run."""
    for processor in os.sched_getaffinity(0):
        threading.Thread(target=_witness, args=(stalls, processor), daemon=True).start()


def _witness(stalls: Stalls, processor: int) -> None:
    os.sched_setaffinity(0, {processor})
    due_ns = time.monotonic_ns()
    while True:
        due_ns += EVERY_NS
        time.sleep(max(due_ns - time.monotonic_ns(), 0) * 1e-9)
        now_ns = time.monotonic_ns()
        stalls.woke(due_ns, now_ns)
        due_ns = max(due_ns, now_ns - EVERY_NS)


def _limit_s(item: pytest.Item) -> float:
    """One timer counts for all runs of a test, and what lies between them."""
    marker = item.get_closest_marker("timeout")
    once_s = float(marker.args[0] if marker else item.config.getini("timeout") or 0)
    return (1 + AGAIN_MAX) * (once_s + HELD_UP_S) + AGAIN_MAX * PATIENCE_S


class HeldUp:
    """The plugin; see `tests/conftest.py`."""

    def __init__(self, stalls: Stalls, begin: Callable[[Stalls], None] = watch) -> None:
        self._stalls = stalls
        self._begin = begin
        self._watched = False
        self._first = 0
        """Of the stalls of the test that runs."""

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """What runs real processes may be run again, and has the time for it."""
        again = pytest.mark.flaky(reruns=AGAIN_MAX, condition=self._was)
        for item in items:
            if item.nodeid.startswith(ALONE):
                item.add_marker(again)
                item.add_marker(pytest.mark.timeout(_limit_s(item)), append=False)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        """A test that is run again finds the computer calm, if there is such a time."""
        if not item.nodeid.startswith(ALONE):
            return
        if not self._watched:
            self._begin(self._stalls)
            self._watched = True
        if getattr(item, "execution_count", 1) > 1:
            end_s = time.monotonic() + PATIENCE_S
            while not self._stalls.calm(time.monotonic_ns()) and time.monotonic() < end_s:
                time.sleep(0.1)
        self._first = len(self._stalls.late_ns)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item):
        """A failure says how the computer was."""
        report = yield
        if report.failed and item.nodeid.startswith(ALONE):
            words = ("this computer", self._words() or "was never held up")
            if hasattr(report.longrepr, "addsection"):
                report.longrepr.addsection(*words)  # which a test that is run again shows as well
            else:
                report.sections.append(words)
        return report

    def _was(self) -> bool:
        return bool(self._words())

    def _words(self) -> str:
        return self._stalls.words(self._first)
