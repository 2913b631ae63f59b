"""Whether a joint answers changes of its drive's effort with the drive's sign."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.core.safety.sign_response import UNCLEAR_MAX_RATIO, WRONG, updated, with_sample

LIMIT_NM = 20.0
SAMPLES, RIGHT_MAX_RATIO = 12, 0.25


def answer(pushes, patients, sign=1.0, before=WRONG):
    """The ratio after a drive of this sign has pushed, and a patient too."""
    samples = ()
    for push, patient in zip(pushes, patients, strict=True):
        samples = with_sample(samples, push, sign * push + patient)
    return updated(before, samples, LIMIT_NM)


def ramp(begin, end):
    return [begin + (end - begin) * k / (SAMPLES - 1) for k in range(SAMPLES)]


def test_a_joint_that_answers_its_drive_has_its_sign_whatever_a_steady_patient_gives():
    for patient_nm in (-70.5, 0.0, 70.5):
        steady = [patient_nm] * SAMPLES
        assert answer(ramp(5.0, -30.0), steady) == pytest.approx(0.0, abs=1e-12)
        assert answer(ramp(5.0, -30.0), steady, sign=-1.0) > 1e6


@pytest.mark.parametrize(
    ("patient_end_nm", "low", "high"),
    [
        (50.0, 0.0, RIGHT_MAX_RATIO),
        (70.0, 0.0, RIGHT_MAX_RATIO),
        (-20.0, RIGHT_MAX_RATIO, UNCLEAR_MAX_RATIO),
        (93.0, RIGHT_MAX_RATIO, UNCLEAR_MAX_RATIO),
        (97.0, UNCLEAR_MAX_RATIO, WRONG),
    ],
)
def test_the_slower_a_patient_changes_the_clearer_is_the_answer(patient_end_nm, low, high):
    ratio = answer(ramp(0.0, -30.0), ramp(60.0, patient_end_nm))

    assert low <= ratio < high


@given(
    st.lists(st.floats(-60.0, 60.0), min_size=SAMPLES, max_size=SAMPLES),
    st.floats(-80.0, 80.0),
    st.floats(-5.0, 5.0),
)
@settings(max_examples=200)
def test_a_reversed_drive_never_has_the_answer_of_a_right_one(pushes, patient_nm, rise_nm):
    """Unless the patient changes more than its push does."""
    patients = [patient_nm + rise_nm * k for k in range(SAMPLES)]
    mean = sum(pushes) / SAMPLES
    spread = math.sqrt(sum((push - mean) ** 2 for push in pushes) / SAMPLES)
    of_patient = abs(rise_nm) * math.sqrt((SAMPLES**2 - 1) / 12)

    if spread > of_patient:
        assert answer(pushes, patients, sign=-1.0) > RIGHT_MAX_RATIO


def test_too_few_samples_and_a_joint_without_any_change_show_nothing():
    assert answer(ramp(0.0, -30.0)[1:], [60.0] * (SAMPLES - 1)) == WRONG
    assert answer([0.0] * SAMPLES, [0.0] * SAMPLES) == WRONG
    assert math.isinf(WRONG)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("at", [0, 1, SAMPLES - 1])
def test_a_number_that_is_not_finite_is_no_patient_s(at, value):
    samples = [(push, push + 70.0) for push in ramp(5.0, -30.0)]
    samples[at] = (samples[at][0], value)

    assert updated(0.1, tuple(samples), LIMIT_NM) == WRONG


def test_only_the_last_samples_count():
    samples = ()
    for k in range(SAMPLES + 3):
        samples = with_sample(samples, float(k), 2.0 * k)

    assert samples == tuple((float(k), 2.0 * k) for k in range(3, SAMPLES + 3))


@pytest.mark.parametrize("at", range(1, SAMPLES))
@pytest.mark.parametrize("cycles", [1, 2])
def test_an_effort_that_jumps_is_no_patient_s_whatever_was_shown(at, cycles):
    pushes = ramp(10.0, -30.0)
    jumps = [60.0 + 10.4 * min(max(k - at + 1, 0), cycles) * 2 / cycles for k in range(SAMPLES)]
    small = [60.0 + 9.6 * min(max(k - at + 1, 0), cycles) * 2 / cycles for k in range(SAMPLES)]
    seen = cycles == 1 or at < SAMPLES - 1

    assert math.isinf(answer(pushes, jumps, before=0.1)) == seen
    assert answer(pushes, small, before=0.1) == 0.1


@pytest.mark.parametrize("patient_nm", [LIMIT_NM, -LIMIT_NM])
def test_a_change_by_the_limit_or_in_three_cycles_is_no_jump(patient_nm):
    for changes in ([1.0], [0.4, 0.8, 1.2]):
        at_limit = [0.0] * 4 + [patient_nm * one for one in changes]
        patients = at_limit + [at_limit[-1]] * (SAMPLES - len(at_limit))

        assert answer([0.0] * SAMPLES, patients, before=0.1) == 0.1
    assert answer([0.0] * SAMPLES, [0.0] * 8 + [1.01 * patient_nm] * 4, before=0.1) == WRONG


def test_what_has_the_drive_s_sign_keeps_it_and_what_is_unclear_is_judged_anew():
    constant = [-30.0] * SAMPLES
    falling = ramp(60.0, 57.0)

    assert answer(constant, falling, before=0.1) == 0.1
    unclear = answer(constant, falling, before=RIGHT_MAX_RATIO)
    assert unclear == pytest.approx(1.0)
    assert answer(ramp(-20.0, -40.0), falling, sign=-1.0, before=1.0) > UNCLEAR_MAX_RATIO


def test_a_reversal_while_a_patient_works_against_the_drive_is_a_jump():
    pushes = ramp(-20.0, -40.0)
    before = [(push, push + 70.0) for push in pushes[:-1]]
    now = (pushes[-1], -pushes[-1] + 70.0)

    assert updated(0.1, (*before, (pushes[-1], pushes[-1] + 70.0)), LIMIT_NM) == 0.1
    assert updated(0.1, (*before, now), LIMIT_NM) == WRONG
