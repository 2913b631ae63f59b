"""Tests of real processes on a computer that others use as well.

A drive that is silent for 30 ms stops the leg, rightly, and nobody can tell it from a computer that
stood still for so long. So witnesses (`stalls.py`) note when it did.

- A test of real processes that failed while the computer stood still has shown nothing: it is run
  again, five times at most, each time once the computer was calm for longer.
- A fixture of many tests that was made while the computer stood still is made anew for that, twice
  at most; behind that it counts as good.
- A test that failed while nothing stood still has failed, in whichever run, and so has one that
  failed in all six.

The summary names each test that was run again, and how the computer was. What pytest's own process
computes in C without a pause looks like a stall as well, so a stall can earn a test another run,
and never excuse it. What is computed for the report of a failure does not count.
"""

import time
from collections import Counter
from collections.abc import Callable, Generator
from typing import Any, Final

import pytest
from stalls import EVERY_NS, Stalls, watch

from gaitd.testing.trainer import HELD_UP_S

BY_THE_CLOCK: Final = ("realtime", "rig_vcan", "rig_systemd")
"""Marks of tests that go by the computer's clock."""
AGAIN_MAX: Final = 5
CALM_S: Final = 2.0
"""Before the first repetition; twice as long before each next one."""
PATIENCE_S: Final = 120.0
"""For a calm computer; then the test is run again all the same."""
MADE_MAX: Final = 3
"""Times a fixture of many tests is made for the sake of a calm computer."""


class HeldUp:
    """The plugin; see `tests/conftest.py`."""

    def __init__(self, stalls: Stalls, begin: Callable[[Stalls], None] = watch) -> None:
        self._stalls = stalls
        self._begin = begin
        self._watched = False
        self._first = 0
        """Of the stalls of the run."""
        self._own = range(0)
        """Those until it failed."""
        self._shared: set[pytest.FixtureDef[Any]] = set()
        """Fixtures of many tests that the run uses."""
        self._while_made: dict[pytest.FixtureDef[Any], range] = {}
        """The stalls while each of those that live was made."""
        self._made_count: Counter[pytest.FixtureDef[Any]] = Counter()
        self._timer: tuple[pytest.Item, Any] | None = None
        """Of pytest-timeout, the newest: whose, and its settings."""

    def pytest_collection_modifyitems(
        self, config: pytest.Config, items: list[pytest.Item]
    ) -> None:
        """What runs real processes may be run again, unless a debugger waits for its failure."""
        reruns = 0 if config.option.usepdb else AGAIN_MAX
        again = pytest.mark.flaky(reruns=reruns, condition=self._was)
        for item in items:
            if _is_realtime(item):
                item.add_marker(again)

    @pytest.hookimpl(tryfirst=True, optionalhook=True)
    def pytest_timeout_set_timer(self, item: pytest.Item, settings: Any) -> object:
        """A virtual trainer has some minutes more to be brought into its mode."""
        if not _is_realtime(item) or (item, settings) == self._timer:
            return None
        self._timer = item, settings._replace(timeout=settings.timeout + HELD_UP_S)
        return item.ihook.pytest_timeout_set_timer(item=item, settings=self._timer[1])

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        """A test that is run again finds the computer calm, if there is such a time."""
        if not _is_realtime(item):
            return
        if not self._watched:
            self._begin(self._stalls)
            self._watched = True
        self._shared = _shared(item)
        run = _run(item)
        if run == 1:
            self._begin_run()
            return
        self._stalls.wait_until_calm(CALM_S * 2 ** (run - 2), PATIENCE_S)
        self._begin_timer_again(item)
        self._begin_run()
        for fixture in self._spoiled():
            fixture.finish(item._request)  # pyright: ignore[reportAttributeAccessIssue]

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef[Any]
    ) -> Generator[None, object, object]:
        """Whoever uses it later wants to know how the computer was."""
        begin = len(self._stalls.late_ns)
        self._made_count[fixturedef] += 1
        try:
            return (yield)
        finally:
            self._while_made[fixturedef] = self._stalls.since(begin)

    def pytest_fixture_post_finalizer(self, fixturedef: pytest.FixtureDef[Any]) -> None:
        """It is there no more."""
        self._while_made.pop(fixturedef, None)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """A failure says how the computer was."""
        alone = _is_realtime(item)
        if alone and call.excinfo is not None:
            self._end_run()
        report = yield
        if not alone or not report.failed:
            return report
        if hasattr(report.longrepr, "addsection"):
            # Which a test that is run again shows as well.
            report.longrepr.addsection("this computer", self._words())
        else:
            report.sections.append(("this computer", self._words()))
        return report

    def _begin_run(self) -> None:
        self._first = len(self._stalls.late_ns)
        self._own = range(0)

    def _end_run(self) -> None:
        time.sleep(4 * EVERY_NS * 1e-9)  # A witness that waits for us tells its last stall.
        self._own = self._stalls.since(self._first)

    def _spoiled(self) -> list[pytest.FixtureDef[Any]]:
        """What this run shares that was made while the computer stood still, and may be again."""
        return [
            fixture
            for fixture in self._shared
            if self._while_made.get(fixture) and self._made_count[fixture] < MADE_MAX
        ]

    def _begin_timer_again(self, item: pytest.Item) -> None:
        """The failure before has ended it, for the sake of debuggers."""
        if self._timer and self._timer[0] is item:
            item.ihook.pytest_timeout_cancel_timer(item=item)
            item.ihook.pytest_timeout_set_timer(item=item, settings=self._timer[1])

    def _was(self) -> bool:
        return bool(self._seen())

    def _seen(self) -> set[int]:
        """The numbers of the stalls that may have made this run fail.

        They are its own, but for those of a fixture that was made often enough; and those of a
        fixture that it found made.
        """
        made_for_good = (
            self._while_made.get(fixture, range(0))
            for fixture in self._shared
            if self._made_count[fixture] >= MADE_MAX
        )
        spoiled = (self._while_made[fixture] for fixture in self._spoiled())
        return set(self._own).difference(*made_for_good).union(*spoiled)

    def _words(self) -> str:
        seen = self._seen()
        if not seen:
            return "was never held up"
        worst_ms = self._stalls.worst_ns(seen) / 1e6
        return f"held up {len(seen)} times, {worst_ms:.0f} ms at most"


def _is_realtime(item: pytest.Item) -> bool:
    return any(item.get_closest_marker(name) for name in BY_THE_CLOCK)


def _run(item: pytest.Item) -> int:
    """From 1 on; of pytest-rerunfailures."""
    return getattr(item, "execution_count", 1)


def _shared(item: pytest.Item) -> set[pytest.FixtureDef[Any]]:
    """The fixtures of many tests that a test uses, those of its fixtures among them."""
    info = getattr(item, "_fixtureinfo", None)
    found = info.name2fixturedefs.values() if info else ()
    return {one for several in found for one in several if one.scope != "function"}
