"""A latched verdict across restarts: when it is stored, when it is dropped, and how it is read."""

import math

import pytest
from msgspec.structs import replace

from daemon.core.modes import latched_stop
from daemon.core.modes.latched_stop import since, updated, verdict_of
from daemon.core.modes.persistent_state import StoredVerdict
from daemon.ipc.record import Cause, Mode, StopCategory, Verdict

JUMPED = Verdict(StopCategory.S0, Cause.ENCODER_JUMP, "right/hip", 2.5, 1.5, "too far")
STORED = StoredVerdict("S0", "ENCODER_JUMP", "right/hip", 2.5, 1.5, "too far", 7)
UNKNOWN = StoredVerdict(
    "S1", "LAST_END_UNKNOWN", value=0.0, limit=0.0, detail="it ended while drives were enabled"
)
ACTIVE = [mode for mode in Mode if mode.active]


@pytest.mark.parametrize("mode", ACTIVE)
def test_with_drives_enabled_an_end_without_notice_is_stored_once(mode):
    first = updated(None, mode, Verdict(), 5)

    assert first is not None
    assert (first.category, first.cause, first.utc_ns) == ("S1", "LAST_END_UNKNOWN", 5)
    assert first.detail == UNKNOWN.detail
    assert updated(first, mode, Verdict(), 6) is first


def test_in_ready_nothing_is_latched_and_before_it_all_stays():
    assert updated(STORED, Mode.READY, JUMPED, 9) is None
    for mode in (Mode.OFF, Mode.BRINGING_UP):
        assert updated(STORED, mode, JUMPED, 9) is STORED
        assert updated(None, mode, JUMPED, 9) is None


@pytest.mark.parametrize("mode", [Mode.STOPPING, Mode.FAULT])
def test_a_verdict_is_stored_with_the_time_of_its_first_cycle(mode):
    first = updated(None, mode, JUMPED, 7)

    assert first == STORED
    assert updated(first, mode, JUMPED, 8) is first
    other = updated(first, mode, replace(JUMPED, value=3.0), 8)
    assert other is not None
    assert (other.value, other.utc_ns) == (3.0, 8)


@pytest.mark.parametrize("cause", [Cause.NONE, Cause.SHUTDOWN, Cause.DRIVE_POWERED])
def test_a_stop_that_was_requested_is_no_verdict_to_keep(cause):
    verdict = Verdict(StopCategory.S2, cause)

    assert updated(STORED, Mode.STOPPING, verdict, 9) is STORED
    in_fault = updated(STORED, Mode.FAULT, verdict, 9)
    assert in_fault is (None if cause is Cause.SHUTDOWN else STORED)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_stored_as_none_and_a_long_text_is_cut(number):
    verdict = replace(JUMPED, value=number, limit=number, detail="x" * 200)

    stored = updated(None, Mode.FAULT, verdict, 7)

    assert stored is not None
    assert (stored.value, stored.limit) == (None, None)
    assert len(stored.detail.encode()) == 120
    read = verdict_of(stored)
    assert (read.value, read.limit) == (0.0, 0.0)


@pytest.mark.parametrize("cause", [one for one in Cause if one not in latched_stop._NOT_LATCHED])
def test_what_is_stored_is_read_as_the_same_verdict(cause):
    verdict = replace(JUMPED, cause=cause)

    stored = updated(None, Mode.FAULT, verdict, 7)

    assert stored is not None
    assert verdict_of(stored) == verdict


def test_a_cause_or_category_of_another_version_still_stops():
    by_cause = verdict_of(StoredVerdict("S0", "MELTED", "right/hip", 1.0, 2.0, "hot", 7))
    by_category = verdict_of(StoredVerdict("S7", "ENCODER_JUMP", "right/hip", 1.0, 2.0, "far", 7))

    assert by_cause == Verdict(
        StopCategory.S0,
        Cause.LAST_END_UNKNOWN,
        "right/hip",
        detail="MELTED, which is of another version",
    )
    assert by_category == Verdict(StopCategory.S1, Cause.ENCODER_JUMP, "right/hip", 1.0, 2.0, "far")


def test_the_time_of_a_latched_stop_is_utc():
    assert since(0) == "before this start"
    assert since(1_700_000_000_000_000_000) == "2023-11-14 22:13:20 UTC"
