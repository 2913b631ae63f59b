"""A test of real processes is run again if the computer was held up, and not otherwise."""

import itertools
import re
import time
from pathlib import Path

import pytest
from held_up import CALM_S, LATE_NS, Stalls, watch

pytest_plugins = ["pytester"]

SUPPORT = Path(__file__).with_name("support")
CONFTEST = """
import sys
sys.path.insert(0, {support!r})
import held_up

held_up.ALONE = ("test_processes.py",)
held_up.CALM_S = 0.2
held_up.HELD_UP_S = 0.0
STALLS = held_up.Stalls()

def pytest_configure(config):
    config.pluginmanager.register(held_up.HeldUp(STALLS, begin=lambda stalls: None))
"""
FAILS_FIRST = """
import time
from conftest import STALLS

RUNS = []

{mark}
def test_it():
    RUNS.append(0)
    if {held_up}:
        STALLS.woke(0, time.monotonic_ns())
    if len(RUNS) == {hangs_at}:
        time.sleep(30)
    assert len(RUNS) == {passes_at}
"""


@pytest.fixture
def outcomes(pytester):
    """Of one test that passes at a certain run."""

    def run(*, held_up, passes_at, hangs_at=0, file="test_processes", mark=""):
        pytester.makeconftest(CONFTEST.format(support=str(SUPPORT)))
        text = FAILS_FIRST.format(
            held_up=held_up, passes_at=passes_at, hangs_at=hangs_at, mark=mark
        )
        pytester.makepyfile(**{file: text})
        ran = pytester.runpytest_subprocess(
            *("-p", "no:cacheprovider", "-p", "no:xdist", "-raR", "--rerun-show-tracebacks")
        )
        return {key: count for key, count in ran.parseoutcomes().items() if count}, ran

    return run


def test_a_failure_while_the_computer_was_held_up_is_run_again_and_told(outcomes):
    found, ran = outcomes(held_up=True, passes_at=2)

    assert found == {"passed": 1, "rerun": 1}
    assert "RERUN test_processes.py::test_it" in ran.stdout.str()
    assert re.search(r"held up 1 times, \d+ ms at most", ran.stdout.str())


def test_a_failure_while_nothing_stood_still_is_a_failure(outcomes):
    found, ran = outcomes(held_up=False, passes_at=2)

    assert found == {"failed": 1}
    assert "was never held up" in ran.stdout.str()


def test_a_test_that_fails_each_time_has_failed_and_says_how_the_computer_was(outcomes):
    found, ran = outcomes(held_up=True, passes_at=10)

    assert found == {"failed": 1, "rerun": 2}
    assert re.search(r"held up 1 times, \d+ ms at most", ran.stdout.str())


def test_what_runs_no_real_process_is_never_run_again(outcomes):
    found, _ = outcomes(held_up=True, passes_at=2, file="test_pure")

    assert found == {"failed": 1}


def test_each_run_of_a_test_has_a_timer_of_its_own(outcomes):
    limit = "@__import__('pytest').mark.timeout(1)"

    found, ran = outcomes(held_up=True, hangs_at=2, passes_at=3, mark=limit)

    assert found == {"passed": 1, "rerun": 2}
    assert "Timeout (>1" in ran.stdout.str()


def test_a_wake_up_later_than_a_cycle_is_a_stall_and_the_computer_is_calm_some_time_after():
    stalls = Stalls()
    stalls.woke(0, LATE_NS)
    assert not stalls.late_ns

    stalls.woke(1000, 1001 + LATE_NS)
    assert stalls.late_ns == [LATE_NS + 1]
    assert not stalls.calm(1001 + LATE_NS)
    assert stalls.calm(round(CALM_S * 1e9) + 2000 + LATE_NS)


def test_a_process_that_computes_without_a_pause_is_seen_by_its_own_witness():
    stalls = Stalls()
    watch(stalls)
    end_s = time.monotonic() + 30

    for size in itertools.count(1):
        sum(range(size * 100_000))  # in C, which lets no other thread run
        if stalls.late_ns or time.monotonic() > end_s:
            break

    stalls.over.set()
    assert stalls.words(0).startswith("held up")
