"""A latched verdict across restarts: when it is stored, when it is dropped, and how it is read."""

import math

import pytest
from gaitd_names import Cause, Finding, Mode, StopCategory
from msgspec.structs import replace

from daemon.core.modes import latched_stop
from daemon.core.modes.latched_stop import updated, verdict_of
from daemon.core.modes.persistent_state import StoredVerdict
from daemon.ipc.record import Verdict

JUMP = Finding.STEP_BETWEEN_SAMPLES
JUMPED = Verdict(StopCategory.S0, Cause.ENCODER_JUMP, "right/hip", 2.5, 1.5, JUMP, "too far")
STORED = StoredVerdict("S0", "encoder_jump", "right/hip", 2.5, 1.5, JUMP, "too far", 7)
ACTIVE = [mode for mode in Mode if mode.active]


@pytest.mark.parametrize("mode", ACTIVE)
def test_with_drives_enabled_an_end_without_notice_is_stored_once(mode):
    first = updated(None, mode, Verdict(), 5)

    assert first is not None
    assert (first.category, first.cause, first.utc_ns) == ("S1", "last_end_unknown", 5)
    assert (first.finding, first.said) == ("ended_while_enabled", "")
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
    verdict = replace(JUMPED, value=number, limit=number, said="x" * 200)

    stored = updated(None, Mode.FAULT, verdict, 7)

    assert stored is not None
    assert (stored.value, stored.limit) == (None, None)
    assert len(stored.said.encode()) == 120
    read = verdict_of(stored)
    assert (read.value, read.limit) == (0.0, 0.0)


@pytest.mark.parametrize("cause", [one for one in Cause if one not in latched_stop._NOT_LATCHED])
def test_what_is_stored_is_read_as_the_same_verdict(cause):
    verdict = replace(JUMPED, cause=cause)

    stored = updated(None, Mode.FAULT, verdict, 7)

    assert stored is not None
    assert verdict_of(stored) == verdict


def test_a_cause_category_or_finding_of_another_version_still_stops():
    by_cause = verdict_of(StoredVerdict("S0", "MELTED", "right/hip", 1.0, 2.0, "BELOW", "hot", 7))
    by_category = verdict_of(replace(STORED, category="S7"))
    by_finding = verdict_of(replace(STORED, finding="MELTED"))

    assert by_cause == Verdict(
        StopCategory.S0,
        Cause.LAST_END_UNKNOWN,
        "right/hip",
        finding=Finding.NOTES_OF_OTHER_VERSION,
        said="MELTED",
    )
    assert by_category == replace(JUMPED, category=StopCategory.S1)
    assert by_finding == replace(JUMPED, finding=Finding.NONE)
