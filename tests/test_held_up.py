"""A test of real processes is run again if the computer was held up, and not otherwise."""

import itertools
import time
from pathlib import Path

import pytest
from held_up import AGAIN_MAX, MADE_MAX
from stalls import LATE_NS, Stalls, watch

pytestmark = pytest.mark.realtime

pytest_plugins = ["pytester"]

SUPPORT = Path(__file__).with_name("support")
CONFTEST = """
import sys
import time

import pytest

sys.path.insert(0, {support!r})
import held_up, stalls

held_up.CALM_S = 0.01
held_up.HELD_UP_S = 0.0
STALLS = stalls.Stalls()

def pytest_configure(config):
    config.addinivalue_line("markers", "realtime: of real processes")
    config.pluginmanager.register(held_up.HeldUp(STALLS, begin=lambda stalls: None))

@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    for item in items:
        if item.nodeid.startswith("test_processes.py"):
            item.add_marker("realtime")

def stall(stall_ms):
    now_ns = time.monotonic_ns()
    STALLS.woke(now_ns - stall_ms * 1_000_000, now_ns)
"""
FAILS_FIRST = """
import pytest
import time
from conftest import stall

RUNS = []
STALLS_MS = {stalls_ms}

{mark}
def test_it():
    stall(STALLS_MS[min(len(RUNS), len(STALLS_MS) - 1)])
    RUNS.append(0)
    if len(RUNS) == {hangs_at}:
        time.sleep(30)
    assert len(RUNS) == {passes_at}, "it is wrong"
"""
NONE_MS, SHORT_MS, LONG_MS = 1, 20, 40
NEVER = 100
RECORDED = """
import pytest
from conftest import stall

MADE = []

@pytest.fixture(scope="module")
def base():
    MADE.append("base")
    stall(40 if len(MADE) in {spoiled} else 1)
    yield len(MADE)
    MADE.append("ended")

@pytest.fixture(scope="module")
def recording(base):
    return base

def test_its_first(recording):
    pass

def test_its_second(recording):
    assert recording > 1, MADE

def test_its_third(recording):
    assert MADE == ["base", "ended", "base"]
    assert recording == 3
"""


@pytest.fixture
def outcomes(pytester):
    """Of a file of tests of real processes, or of other ones."""

    def run(text, file="test_processes", more=""):
        pytester.makeconftest(CONFTEST.format(support=str(SUPPORT)) + more)
        pytester.makepyfile(**{file: text})
        ran = pytester.runpytest_subprocess(
            *("-p", "no:cacheprovider", "-p", "no:xdist", "-raR", "--rerun-show-tracebacks")
        )
        return {key: count for key, count in ran.parseoutcomes().items() if count}, ran

    return run


def fails_first(*stalls_ms, passes_at=NEVER, hangs_at=0, mark=""):
    """A test that passes at a certain run, and the stall of each of its runs."""
    return FAILS_FIRST.format(
        stalls_ms=stalls_ms, passes_at=passes_at, hangs_at=hangs_at, mark=mark
    )


def test_a_failure_while_the_computer_was_held_up_is_run_again_and_told(outcomes):
    found, ran = outcomes(fails_first(SHORT_MS, passes_at=2))

    assert found == {"passed": 1, "rerun": 1}
    assert "RERUN test_processes.py::test_it" in ran.stdout.str()
    assert "held up 1 times, 20 ms at most" in ran.stdout.str()


def test_a_failure_while_nothing_stood_still_is_a_failure(outcomes):
    found, ran = outcomes(fails_first(NONE_MS, passes_at=2))

    assert found == {"failed": 1}
    assert "was never held up" in ran.stdout.str()


def test_a_test_that_fails_beside_a_stall_each_time_has_failed_however_long_those_were(outcomes):
    found, ran = outcomes(fails_first(LONG_MS))

    assert found == {"failed": 1, "rerun": AGAIN_MAX}
    assert "held up 1 times, 40 ms at most" in ran.stdout.str()


def test_a_test_that_fails_once_while_nothing_stood_still_has_failed_after_all(outcomes):
    found, _ = outcomes(fails_first(LONG_MS, LONG_MS, NONE_MS))

    assert found == {"failed": 1, "rerun": 2}


def test_what_runs_no_real_process_is_never_run_again(outcomes):
    found, _ = outcomes(fails_first(LONG_MS, passes_at=2), file="test_pure")

    assert found == {"failed": 1}


def test_what_was_recorded_for_many_tests_on_a_computer_that_stood_still_is_recorded_anew(outcomes):
    found, ran = outcomes(RECORDED.replace("{spoiled}", "(1,)"))

    assert found == {"passed": 3, "rerun": 1}, ran.stdout.str()
    assert "held up 1 times, 40 ms at most" in ran.stdout.str()


def test_what_was_recorded_often_enough_counts_as_good(outcomes):
    text = RECORDED.replace("{spoiled}", "range(99)").replace("recording == 3", "False")

    found, ran = outcomes(text)

    assert found == {"passed": 2, "failed": 1, "rerun": MADE_MAX - 1}, ran.stdout.str()
    assert "was never held up" in ran.stdout.str()


def test_what_the_report_of_a_failure_takes_is_no_evidence(outcomes):
    reports = "def pytest_runtest_makereport(item, call):\n    stall(40 if call.excinfo else 1)\n"

    found, ran = outcomes(fails_first(NONE_MS), more=reports)

    assert found == {"failed": 1}
    assert "was never held up" in ran.stdout.str()


def test_each_run_of_a_test_has_a_timer_of_its_own(outcomes):
    limit = "@pytest.mark.timeout(1)"

    found, ran = outcomes(fails_first(SHORT_MS, hangs_at=2, passes_at=3, mark=limit))

    assert found == {"passed": 1, "rerun": 2}
    assert "Timeout (>1" in ran.stdout.str()


def test_a_wake_up_later_than_a_cycle_is_a_stall_and_the_computer_is_calm_some_time_after():
    stalls = Stalls()
    stalls.woke(0, LATE_NS)
    assert not stalls.late_ns

    stalls.woke(1000, 1001 + LATE_NS)
    assert stalls.late_ns == [LATE_NS + 1]
    assert not stalls.calm(1001 + LATE_NS, calm_s=2.0)
    assert stalls.calm(2_000_002_000 + LATE_NS, calm_s=2.0)


def test_a_process_that_computes_without_a_pause_is_seen_by_its_own_witness():
    stalls = Stalls()
    watch(stalls)
    end_s = time.monotonic() + 30

    for size in itertools.count(1):
        sum(range(size * 100_000))  # in C, which lets no other thread run
        if stalls.late_ns or time.monotonic() > end_s:
            break

    stalls.over.set()
    assert stalls.worst_ns(stalls.since(0)) > LATE_NS
