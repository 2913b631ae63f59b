"""Tests of real processes on a computer that others use as well.

A drive that is silent for 30 ms stops the leg, rightly, and nobody can tell it from a computer that
stood still for so long. So a witness on each processor wakes up every 5 ms and notes when it came
late. A test of real processes that failed while that happened has shown nothing: it is run again,
once the computer is calm, twice at most, and the summary tells of it. One that failed while nothing
stood still has failed.

What pytest's own process computes in C without a pause looks the same to a witness. What happened
to a fixture of many tests before the one that failed is not asked for: it would not be made anew.
"""

import os
import threading
import time
from collections.abc import Callable
from typing import Any, Final

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
        self.over = threading.Event()
        """Nobody watches any more."""

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


class HeldUp:
    """The plugin; see `tests/conftest.py`."""

    def __init__(self, stalls: Stalls, begin: Callable[[Stalls], None] = watch) -> None:
        self._stalls = stalls
        self._begin = begin
        self._watched = False
        self._first = 0
        """Of the stalls of the test that runs."""
        self._timer: tuple[pytest.Item, Any] | None = None
        """Of pytest-timeout, the newest: whose, and its settings."""

    def pytest_collection_modifyitems(
        self, config: pytest.Config, items: list[pytest.Item]
    ) -> None:
        """What runs real processes may be run again, unless a debugger waits for its failure."""
        reruns = 0 if config.option.usepdb else AGAIN_MAX
        again = pytest.mark.flaky(reruns=reruns, condition=self._was)
        for item in items:
            if item.nodeid.startswith(ALONE):
                item.add_marker(again)

    @pytest.hookimpl(tryfirst=True, optionalhook=True)
    def pytest_timeout_set_timer(self, item: pytest.Item, settings: Any) -> object:
        """A virtual trainer has some minutes more to be brought into its mode."""
        if not item.nodeid.startswith(ALONE) or (item, settings) == self._timer:
            return None
        self._timer = item, settings._replace(timeout=settings.timeout + HELD_UP_S)
        return item.ihook.pytest_timeout_set_timer(item=item, settings=self._timer[1])

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
            self._begin_timer_again(item)
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

    def _begin_timer_again(self, item: pytest.Item) -> None:
        """The failure before has ended it, for the sake of debuggers."""
        if self._timer and self._timer[0] is item:
            item.ihook.pytest_timeout_cancel_timer(item=item)
            item.ihook.pytest_timeout_set_timer(item=item, settings=self._timer[1])

    def _was(self) -> bool:
        return bool(self._words())

    def _words(self) -> str:
        return self._stalls.words(self._first)
