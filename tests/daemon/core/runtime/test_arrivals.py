"""When frames came, by the kernel's stamps, however the wall clock is set meanwhile."""

from dataclasses import dataclass

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from daemon.core.runtime.arrivals import (
    KNOWN_WITHIN_NS,
    ROUNDING_NS,
    ClockPair,
    answered_ns,
    read_clocks,
    sort_out,
)
from drives.canopen.bus import Frame

MS, HOUR_NS = 1_000_000, 3_600_000_000_000
AHEAD_NS = 1_767_225_600 * 1_000_000_000
"""What the wall clock is ahead of the monotonic one by, before it is stepped."""
SYNC_NS = 50_000 * MS


def pair(mono_ns, ahead_ns=AHEAD_NS, interrupted_ns=0):
    """Both clocks as read at `mono_ns`, another process running in between."""
    return ClockPair(mono_ns, mono_ns + interrupted_ns // 2 + ahead_ns, mono_ns + interrupted_ns)


def is_before(stamp_utc_ns, begun, ended):
    answers, _ = sort_out([Frame(0x185, b"", stamp_utc_ns)], begun, ended)
    return not answers


@dataclass
class WallClock:
    """Runs with the monotonic clock until it is stepped by `stepped_ns` at `at_ns`."""

    at_ns: int
    stepped_ns: int

    def ahead_ns(self, mono_ns):
        return AHEAD_NS + (self.stepped_ns if mono_ns >= self.at_ns else 0)

    def stamp(self, mono_ns):
        """What the kernel writes on a frame that comes now, after python-can's float."""
        return int((mono_ns + self.ahead_ns(mono_ns)) * 1e-9 * 1e9)

    def read(self, mono_ns, interrupted_ns):
        middle_ns = mono_ns + interrupted_ns // 2
        return ClockPair(mono_ns, middle_ns + self.ahead_ns(middle_ns), mono_ns + interrupted_ns)


steps = st.one_of(
    st.integers(-HOUR_NS, HOUR_NS), st.integers(-20 * MS, 20 * MS), st.sampled_from([0])
)
interruptions = st.integers(0, 3 * MS)


@example(  # by more than the time since the computer was switched on
    came_after_ns=2 * MS, read_after_ns=0, step_after_ns=MS, stepped_ns=-HOUR_NS, first=0, second=0
)
@given(
    came_after_ns=st.integers(0, 8 * MS),
    read_after_ns=st.integers(0, 8 * MS),
    step_after_ns=st.integers(-20 * MS, 20 * MS),
    stepped_ns=steps,
    first=interruptions,
    second=interruptions,
)
def test_an_answer_stays_one_wherever_one_step_of_the_wall_clock_falls(
    came_after_ns, read_after_ns, step_after_ns, stepped_ns, first, second
):
    clock = WallClock(SYNC_NS + step_after_ns, stepped_ns)
    begun = clock.read(SYNC_NS, first)
    came_ns = begun.after_ns + came_after_ns
    ended = clock.read(came_ns + read_after_ns, second)

    assert not is_before(clock.stamp(came_ns), begun, ended)


@example(early_ns=10 * MS, read_after_ns=0, step_before_ns=5 * MS, stepped_ns=HOUR_NS)
@given(
    early_ns=st.integers(2 * ROUNDING_NS, 200 * MS),
    read_after_ns=st.integers(0, 8 * MS),
    step_before_ns=st.integers(0, 200 * MS),
    stepped_ns=st.one_of(
        st.integers(-HOUR_NS, -210 * MS), st.integers(0, HOUR_NS), st.sampled_from([0])
    ),
)
def test_what_came_before_the_sync_is_no_answer_though_the_clock_was_set_in_between(
    early_ns, read_after_ns, step_before_ns, stepped_ns
):
    clock = WallClock(SYNC_NS - step_before_ns, stepped_ns)

    stamp_ns = clock.stamp(SYNC_NS - early_ns)

    assert is_before(stamp_ns, clock.read(SYNC_NS, 0), clock.read(SYNC_NS + read_after_ns, 0))


@given(stepped_ns=st.integers(-HOUR_NS, HOUR_NS), early_ns=st.integers(0, 10 * MS))
def test_in_the_window_of_the_step_itself_only_what_is_certain_is_refused(stepped_ns, early_ns):
    clock = WallClock(SYNC_NS + 1 * MS, stepped_ns)
    begun, ended = clock.read(SYNC_NS, 0), clock.read(SYNC_NS + 2 * MS, 0)

    refused = is_before(clock.stamp(SYNC_NS - early_ns), begun, ended)

    assert not refused or early_ns > 0


@given(
    slewed_ppm=st.integers(-100_000, 100_000),
    came_after_ns=st.integers(0, 4 * MS),
    read_after_ns=st.integers(0, 4 * MS),
)
def test_a_clock_that_is_slewed_as_fast_as_any_daemon_does_loses_no_answer(
    slewed_ppm, came_after_ns, read_after_ns
):
    def ahead_ns(mono_ns):
        return AHEAD_NS + (mono_ns - SYNC_NS) * slewed_ppm // 1_000_000

    came_ns = SYNC_NS + came_after_ns
    ended_ns = came_ns + read_after_ns

    stamp_ns = came_ns + ahead_ns(came_ns)
    assert not is_before(stamp_ns, pair(SYNC_NS), pair(ended_ns, ahead_ns(ended_ns)))


@pytest.mark.parametrize(
    ("came_ns", "interrupted_ns", "is_late"),
    [
        *((-501, (0, 0), True), (-500, (0, 0), False)),
        *((MS + 500, (0, 0), False), (MS + 501, (0, 0), True)),
        *((-551, (100, 0), True), (-550, (100, 0), False)),
        *((MS + 650, (0, 100), False), (MS + 651, (0, 100), True)),
    ],
)
def test_a_stamp_is_refused_beyond_its_rounding_and_the_reading_of_the_clocks(
    came_ns, interrupted_ns, is_late
):
    stamp_ns = SYNC_NS + came_ns + AHEAD_NS
    begun = pair(SYNC_NS, interrupted_ns=interrupted_ns[0])
    ended = pair(SYNC_NS + MS, interrupted_ns=interrupted_ns[1])

    assert is_before(stamp_ns, begun, ended) is is_late


@pytest.mark.parametrize(
    ("came_ns", "interrupted_ns", "answer_ns"),
    [
        *((-1, (0, 0), 0), (0, (0, 0), 0), (3, (0, 0), 3)),
        *((150, (100, 0), 50), (150, (1, 0), 149)),
        *((700_000, (0, 99_000), 700_000), (700_000, (0, 99_001), None)),
    ],
)
def test_an_answer_is_timed_from_the_sync_if_its_stamp_is_certain_enough(
    came_ns, interrupted_ns, answer_ns
):
    stamp_ns = SYNC_NS + came_ns + AHEAD_NS
    begun = pair(SYNC_NS, interrupted_ns=interrupted_ns[0])
    ended = pair(SYNC_NS + MS, interrupted_ns=interrupted_ns[1])

    assert answered_ns(stamp_ns, begun, ended) == answer_ns


def test_a_frame_without_a_stamp_is_taken_in_the_order_of_reading():
    begun, ended = pair(SYNC_NS), pair(SYNC_NS + MS)

    assert not is_before(0, begun, ended)
    assert answered_ns(0, begun, ended) is None


def test_old_samples_are_sorted_out_and_what_the_controller_says_is_not():
    old = SYNC_NS - MS + AHEAD_NS
    new = SYNC_NS + MS + AHEAD_NS
    frames = [Frame(0x185, b"", old), Frame(0x185, b"", new), Frame(0x040, b"", old, is_error=True)]

    answers, others = sort_out(frames, pair(SYNC_NS), pair(SYNC_NS + 2 * MS))

    assert answers == frames[1:]
    assert others == frames[:1]


def test_the_time_of_an_answer_does_not_depend_on_when_it_was_read():
    stamp_ns = SYNC_NS + 700_000 + AHEAD_NS
    verdicts = {
        answered_ns(stamp_ns, pair(SYNC_NS), pair(SYNC_NS + read_ns))
        for read_ns in (MS, 4 * MS, 9 * MS)
    }

    assert verdicts == {700_000}


@pytest.mark.parametrize("ahead_ns", [AHEAD_NS, 1 - SYNC_NS], ids=["2026", "1970"])
def test_no_time_of_an_answer_is_told_where_the_wall_clock_was_set_or_its_reading_interrupted(
    ahead_ns,
):
    stamp_ns = SYNC_NS + MS + ahead_ns
    begun = pair(SYNC_NS, ahead_ns)
    torn = pair(SYNC_NS + 2 * MS, ahead_ns, interrupted_ns=2 * KNOWN_WITHIN_NS)

    for step_ns in (-3 * MS, HOUR_NS):
        stepped = pair(SYNC_NS + 2 * MS, ahead_ns + step_ns)
        assert answered_ns(stamp_ns, begun, stepped) is None
    assert answered_ns(stamp_ns, begun, torn) is None


def test_the_wall_clock_is_read_between_two_looks_at_the_other():
    class Clock:
        def __init__(self):
            self.calls = []

        def now_ns(self):
            self.calls.append("mono")
            return len(self.calls)

        def utc_ns(self):
            self.calls.append("utc")
            return AHEAD_NS

        def sleep_until(self, deadline_ns):
            raise AssertionError(deadline_ns)

    clock = Clock()

    assert read_clocks(clock) == ClockPair(1, AHEAD_NS, 3)
    assert clock.calls == ["mono", "utc", "mono"]
