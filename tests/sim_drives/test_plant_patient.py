"""The scripted patient: what the table says is what the joints feel."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trainers import LEG, MS, order, programme, run, torque, trainer

from observer.mechanism.mechanism import gravity
from sim_drives.plant.actuation import Actuation
from sim_drives.plant.patient import envelope, follow_stride, resting_stride, swing_weight
from sim_drives.plant.plant import HIP, SLIDE, UnknownProgrammeError

STEP_S = 0.00025


def holding(**changes):
    plant = trainer(**changes)
    for axis in (HIP, SLIDE):
        plant.set_axis(axis, order(axis, Actuation.HOLD))
    return plant


def efforts(plant, seconds, every_s=0.01):
    rows = []
    for _ in range(round(seconds / every_s)):
        run(plant, every_s)
        rows.append(plant.truth().patient)
    return np.array(rows)


def test_a_passive_patient_exerts_nothing():
    assert np.all(efforts(holding(), 1.0) == 0.0)


def test_a_sine_over_time_is_that_sine():
    wave = {"kind": "sine", "hip.torque_nm": 4.0, "slide.force_n": 30.0, "frequency_hz": 0.5}
    phases = {"hip.phase_deg": -90.0, "slide.phase_deg": 0.0}
    plant = holding(patient=programme(wave | phases))

    rows = efforts(plant, 2.0)

    time_s = np.arange(1, 201) * 0.01
    assert rows[:, HIP] == pytest.approx(4.0 * np.sin(math.pi * time_s), abs=0.02)
    assert rows[:, SLIDE] == pytest.approx(30.0 * np.cos(math.pi * time_s), abs=0.2)


def test_a_ramp_rises_over_its_time_and_ends_where_it_should():
    ramp = {"kind": "steady", "hip.torque_nm": 10.0, "at_s": 0.5, "rise_s": 1.0, "until_s": 2.0}
    rows = efforts(holding(patient=programme(ramp)), 2.5)[:, HIP]

    assert rows[48] == 0.0
    assert rows[99] == pytest.approx(5.0, abs=0.02)
    assert rows[180] == 10.0
    assert rows[-1] == 0.0


def test_muscles_follow_the_script_with_their_activation():
    step = {"kind": "steady", "hip.torque_nm": 10.0}
    rows = efforts(holding(patient=programme(step, activation_s=0.1)), 1.0)[:, HIP]

    assert rows[9] == pytest.approx(10.0 * (1 - math.exp(-1)), rel=0.01)
    assert rows[-1] == pytest.approx(10.0, rel=0.001)


def test_a_push_at_rest_is_whole_while_the_leg_stands_and_fades_where_it_gives_way():
    push = {
        "kind": "push",
        "hip.torque_nm": 20.0,
        "hip.rest_rad_per_s": 0.3,
        "slide.rest_m_per_s": 0.1,
    }
    against_a_wall = holding(patient=programme(push))
    free = trainer(patient=programme(push))

    assert efforts(against_a_wall, 0.5)[-1, HIP] == pytest.approx(20.0, rel=0.01)
    assert 0.0 < efforts(free, 0.3)[-1, HIP] < 15.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_spasm_acts_against_the_motion_at_its_onset_and_keeps_its_direction(side):
    spasm = {"kind": "spasm", "hip.torque_nm": 30.0, "at_s": 0.3, "until_s": 1.3, "rise_s": 0.05}
    plant = trainer(patient=programme(spasm))
    plant.set_axis(SLIDE, order(SLIDE, Actuation.HOLD))
    rows = []
    for _ in range(1200):
        balance = gravity(LEG, np.array(plant.truth().position))[HIP]
        push = order(HIP, Actuation.TORQUE, target_effort_si=balance + 14.0 * side)
        plant.set_axis(HIP, push)
        plant.advance(plant.now_ns + MS)
        rows.append((plant.truth().velocity[HIP], plant.truth().patient[HIP]))

    before, after = np.array(rows[:295]), np.array(rows[360:1200])
    assert side * before[-1, 0] > 0.1
    assert np.all(after[:, 1] == -30.0 * side)
    assert (side * after[:, 0]).min() < 0.0  # it throws the leg back, and does not turn with it


def test_a_programme_can_repeat_itself():
    once = {"kind": "steady", "hip.torque_nm": 5.0, "until_s": 0.1}
    table = programme(once)
    table["programme"][0]["repeat_s"] = 0.5
    rows = efforts(holding(patient=table), 1.5)[:, HIP]

    active = rows > 0
    assert [bool(active[k]) for k in (5, 30, 55, 80, 105)] == [True, False, True, False, True]


def test_a_programme_starts_when_it_is_asked_for():
    script = programme({"kind": "steady", "hip.torque_nm": 5.0, "at_s": 0.2}) | {"start": "passive"}
    plant = holding(patient=script)
    run(plant, 1.0)
    assert plant.truth().programme == "passive"

    plant.patient("script")
    rows = efforts(plant, 0.4)[:, HIP]

    assert rows[15] == 0.0
    assert rows[-1] == 5.0
    assert plant.truth().programme == "script"


def test_an_effort_from_elsewhere_replaces_the_programme_until_another_one_starts():
    plant = holding()
    plant.exert(5.0, -30.0)
    first = efforts(plant, 0.5)[-1]
    plant.exert(-2.0, 10.0)
    second = efforts(plant, 0.5)[-1]

    assert tuple(first) == pytest.approx((5.0, -30.0), rel=1e-3)
    assert tuple(second) == pytest.approx((-2.0, 10.0), rel=1e-3)
    assert plant.truth().programme == "computed"
    plant.patient("passive")
    assert np.all(np.abs(efforts(plant, 1.0)[-1]) < 1e-6)


def test_an_unknown_programme_is_refused_with_the_names_there_are():
    with pytest.raises(UnknownProgrammeError, match="passive, active"):
        trainer().patient("asleep")


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.floats(-5, 20), st.floats(0, 10), st.floats(0, 3, exclude_min=False), st.floats(0, 3))
def test_an_envelope_stays_between_nothing_and_all_and_is_nothing_outside(
    now_s, length_s, rise_s, fall_s
):
    weight = envelope(now_s, length_s - now_s, float(rise_s), float(fall_s))

    assert 0.0 <= weight <= 1.0
    if now_s < 0 or now_s >= length_s:
        assert weight == 0.0


HARMONICS_DEG = ((20.129, -3.2), (-4.62, -3.167), (-0.231, 1.455), (0.862, 0.542))


def hip_of_gait(phase, amplitude=1.0):
    swing = sum(
        a * math.cos(n * phase) + b * math.sin(n * phase)
        for n, (a, b) in enumerate(HARMONICS_DEG, 1)
    )
    return math.radians(13.98 + amplitude * swing)


@pytest.mark.parametrize("cadence_hz", [0.15, 0.7])
def test_the_patient_has_found_the_phase_four_strides_after_the_gait_has_begun(cadence_hz):
    """The gait rises over two strides in cadence and amplitude, as the service plays it."""
    stride = resting_stride(hip_of_gait(0.0, 0.0))
    phase, errors = 0.0, []
    while phase < 2 * math.pi * 8:
        rise = min(max(phase / (4 * math.pi), 0.1), 1.0)
        phase += 2 * math.pi * cadence_hz * rise * STEP_S
        follow_stride(stride[0], hip_of_gait(phase, rise), STEP_S)
        if phase > 2 * math.pi * 6:
            theta = math.atan2(stride[0]["quadrature_rad"], stride[0]["in_phase_rad"])
            fundamental = phase - math.atan2(HARMONICS_DEG[0][1], HARMONICS_DEG[0][0])
            errors.append(math.remainder(theta - fundamental, 2 * math.pi))

    assert np.abs(errors).max() < math.radians(20)
    assert swing_weight(stride[0]) == 1.0


def test_a_resting_leg_has_no_stride():
    stride = resting_stride(0.3)
    for step in range(40_000):
        follow_stride(stride[0], 0.3 + 0.01 * math.sin(step * STEP_S), STEP_S)

    assert swing_weight(stride[0]) == 0.0


def test_a_patient_who_walks_along_does_nothing_until_the_leg_swings():
    along = {"kind": "gait", "hip.torque_nm": 8.0, "slide.force_n": 40.0, "harmonic": 1}
    phases = {"hip.phase_deg": 90.0, "slide.phase_deg": 60.0}

    rows = efforts(holding(patient=programme(along | phases)), 2.0)

    assert np.all(rows == 0.0)


def test_the_active_patient_of_the_demonstration_helps_both_axes():
    """Swung by a spring along a sine, the work of a patient who walks along is positive."""
    plant = trainer(patient={"start": "active"})
    for step in range(2400):
        phase = 2 * math.pi * 0.25 * step * 0.01
        truth = plant.truth()
        goal = np.array([0.24 + 0.3 * math.cos(phase), 0.55 + 0.2 * math.cos(phase - 0.4)])
        pull = np.array([200.0, 3000.0]) * (goal - truth.position)
        damping = np.array([15.0, 200.0]) * truth.velocity
        torque(plant, *(gravity(LEG, np.array(truth.position)) + pull - damping))
        run(plant, 0.01)

    assert plant.work()["patient"] > 50.0
