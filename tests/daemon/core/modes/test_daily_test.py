"""The daily test: which inputs were observed, and how long results are valid."""

import itertools

import pytest
from gaitd_names import Finding, SelfTestDue, Untested
from msgspec.structs import replace

from daemon.core.exercises.self_test import AxisResult
from daemon.core.modes.daily_test import (
    Clock,
    Drive,
    check_clock,
    counts,
    due,
    stored_test,
    untested,
    with_inputs,
)
from daemon.core.modes.persistent_state import (
    PersistentState,
    StoredAxisTest,
    StoredInputs,
    StoredSelfTest,
)
from drives.signals import Input

NOW = 1_700_000_000_000_000_000
SLEW_NS, STORE_NS = 2_000_000_000, 60_000_000_000
BOTH = Input.HAND_SWITCH_CLOSED | Input.STO_RELEASED
HIP = Drive("right/hip", 11, BOTH)
SLIDE = Drive("right/slide", 12, BOTH)
VALID_H = 12.0
VALID_NS = 12 * 3_600_000_000_000


# --- the clock ------------------------------------------------------------------------------------


def test_time_goes_on_and_the_latest_is_kept():
    assert check_clock(NOW, NOW + 5) == Clock(NOW + 5, back_s=0.0)
    assert check_clock(NOW, NOW) == Clock(NOW)


def test_a_clock_that_is_slewed_back_is_not_set_back():
    assert check_clock(NOW, NOW - SLEW_NS) == Clock(NOW)


def test_a_clock_that_is_set_back_is_told_by_how_much_and_counts_from_there():
    early_ns = NOW - SLEW_NS - 1_000_000_000

    assert check_clock(NOW, early_ns) == Clock(early_ns, pytest.approx(3.0))
    assert check_clock(NOW, NOW - SLEW_NS - 1).back_s > 0
    assert check_clock(NOW, NOW // 4).back_s == pytest.approx(NOW * 0.75e-9)


# --- inputs ---------------------------------------------------------------------------------------


def observed(*inputs, serial_number=11, before=PersistentState(), utc_ns=NOW):  # noqa: B008 - frozen
    for one in inputs:
        before = with_inputs(before, HIP._replace(inputs=one, serial_number=serial_number), utc_ns)
    return before


@pytest.mark.parametrize(
    ("inputs", "seen"),
    [
        (Input.NONE, {"hand_switch_open_utc_ns", "sto_active_utc_ns"}),
        (Input.HAND_SWITCH_CLOSED, {"hand_switch_closed_utc_ns", "sto_active_utc_ns"}),
        (Input.STO_RELEASED, {"hand_switch_open_utc_ns", "sto_released_utc_ns"}),
        (BOTH, {"hand_switch_closed_utc_ns", "sto_released_utc_ns"}),
    ],
)
def test_each_input_is_stored_in_the_state_in_which_it_is(inputs, seen):
    assert observed(inputs).inputs == {
        "right/hip": StoredInputs(serial_number=11, **dict.fromkeys(seen, NOW))
    }


def test_without_a_sample_nothing_is_stored():
    persistent = PersistentState()

    assert observed(None, before=persistent) is persistent


def test_unchanged_inputs_are_stored_anew_only_after_a_while_or_by_a_clock_set_back():
    first = observed(BOTH)

    assert observed(BOTH, before=first, utc_ns=NOW + STORE_NS) is first
    for utc_ns in (NOW + STORE_NS + 1, NOW - 1):
        later = observed(BOTH, before=first, utc_ns=utc_ns)
        assert later.inputs["right/hip"].sto_released_utc_ns == utc_ns
        assert later.inputs["right/hip"].hand_switch_closed_utc_ns == utc_ns


def test_another_axis_keeps_its_notes():
    persistent = with_inputs(observed(BOTH), SLIDE, NOW)

    assert set(persistent.inputs) == {"right/hip", "right/slide"}


def left(persistent, drive=HIP, utc_ns=NOW):
    return untested(persistent, [drive], utc_ns, VALID_H)


def test_every_state_must_be_observed_once():
    one, other, sto, released = ((HIP.axis, state) for state in Untested)
    assert left(PersistentState()) == (one, other, sto, released)
    assert left(observed(BOTH)) == (one, sto)
    assert left(observed(Input.NONE)) == (other, released)
    assert left(observed(BOTH, Input.NONE)) == ()
    assert len(untested(observed(BOTH, Input.NONE), [HIP, SLIDE], NOW, VALID_H)) == 4


def test_what_was_observed_is_valid_for_its_time():
    whole = observed(BOTH, Input.NONE)

    assert left(whole, utc_ns=NOW + VALID_NS) == ()
    assert len(left(whole, utc_ns=NOW + VALID_NS + 1)) == 4


def test_inputs_of_another_drive_count_no_more_and_an_unknown_one_is_not_another():
    whole = observed(BOTH, Input.NONE)

    assert len(left(whole, HIP._replace(serial_number=99))) == 4
    assert left(whole, HIP._replace(serial_number=0)) == ()
    exchanged = observed(BOTH, before=whole, serial_number=99)
    assert exchanged.inputs["right/hip"] == StoredInputs(0, NOW, 0, NOW, serial_number=99)


# --- the self-test --------------------------------------------------------------------------------

AXIS_TEST = StoredAxisTest(1.0, 1.0, 0.0, 0.1, serial_number=11)
PASSED = StoredSelfTest(NOW, passed=True, leg_digest="leg", axes={"right/hip": AXIS_TEST})


def reason(stored, drives=(HIP,), digest="leg", utc_ns=NOW):
    return due(stored, drives, digest, utc_ns, VALID_H)


def test_a_test_that_was_passed_is_valid_for_its_time():
    assert reason(PASSED) is SelfTestDue.NONE
    assert reason(PASSED, utc_ns=NOW + VALID_NS) is SelfTestDue.NONE
    assert reason(PASSED, utc_ns=NOW + VALID_NS + 1) is SelfTestDue.TOO_OLD


@pytest.mark.parametrize(
    ("stored", "change", "why"),
    [
        (None, {}, SelfTestDue.NOT_PASSED_TODAY),
        (replace(PASSED, passed=False), {}, SelfTestDue.FAILED),
        (PASSED, {"digest": "other"}, SelfTestDue.OTHER_ROBOT_FILE),
        (PASSED, {"digest": "earlier"}, SelfTestDue.OTHER_ROBOT_FILE),
        (PASSED, {"drives": (HIP, SLIDE)}, SelfTestDue.OTHER_AXES),
        (
            PASSED,
            {"drives": (HIP._replace(serial_number=99),)},
            SelfTestDue.OTHER_DRIVE,
        ),
        (PASSED, {"drives": (HIP._replace(serial_number=0),)}, SelfTestDue.NONE),
    ],
)
def test_what_is_missing_is_named(stored, change, why):
    assert reason(stored, **change) is why


@pytest.mark.parametrize(
    ("age_ns", "valid"),
    [(0, True), (VALID_NS, True), (VALID_NS + 1, False), (-SLEW_NS, True), (-SLEW_NS - 1, False)],
)
def test_a_result_counts_for_its_time_and_never_from_the_future(age_ns, valid):
    assert counts(NOW, NOW + age_ns, VALID_H) is valid


def test_what_was_never_seen_does_not_count_however_early_the_clock():
    assert not counts(0, 5, VALID_H)
    assert not counts(-1, 5, VALID_H)
    assert counts(1, 5, VALID_H)


@pytest.mark.parametrize(
    "faults",
    list(itertools.product((Finding.NONE, Finding.FRICTION_MORE, Finding.NOT_BEGUN), repeat=2)),
)
def test_a_finished_test_is_stored_and_passed_only_without_any_fault(faults):
    results = [
        AxisResult(name, 5.0 + k, 1.1, 0.2, 0.3, fault=fault)
        for k, (name, fault) in enumerate(zip(("right/hip", "right/slide"), faults, strict=True))
    ]

    stored = stored_test(results, {"right/hip": 11, "right/slide": 12}, "leg", NOW)

    assert stored == StoredSelfTest(
        NOW,
        passed={*faults} == {Finding.NONE},
        leg_digest="leg",
        axes={
            "right/hip": StoredAxisTest(5.0, 1.1, 0.2, 0.3, 11),
            "right/slide": StoredAxisTest(6.0, 1.1, 0.2, 0.3, 12),
        },
    )
