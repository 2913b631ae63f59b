"""The friction drift monitor: what it says of friction that is off, and of patients."""

import math

import numpy as np
import pytest

from observer.drift import (
    CERTAIN_EDGES,
    Drift,
    Sample,
    asks_for_calibration,
    correlation,
    friction_error,
    is_no_friction,
    is_offset,
    is_sloped,
    offset_error,
    slope_error,
    updated,
)
from observer.filter.leg_observer import setup_of
from observer.filter.status import Validity
from observer.mechanism.friction import EVERYWHERE, OverPosition
from observer.offline import batch
from tests.observer.trainer import (
    HIP,
    PATIENT,
    PROTOTYPE,
    SLIDE_FRICTION,
    TUNING,
    encoded,
    gait,
    simulate,
)

SHIPPED = TUNING._replace(velocity_gated=True, patient_noise_max_ratio=20.0)
LAWS = (HIP, SLIDE_FRICTION)


def of_levels(f, ratio):
    return f._replace(stribeck=f.stribeck * ratio, coulomb=f.coulomb * ratio)


@pytest.fixture(scope="module")
def excited():
    """The empty machine in open-loop motion of both axes, its friction as it is."""
    time_s = (np.arange(2500) + 0.5) * 0.01
    drive = np.column_stack(
        (10.0 * np.sin(2 * np.pi * 0.3 * time_s), 95.0 * np.sin(2 * np.pi * 0.2 * time_s))
    )
    return encoded(simulate(PROTOTYPE, 2500, drive=drive))


def drifts(estimates, laws=LAWS):
    """What the core would have gathered, of both axes."""
    found = []
    for axis, law in enumerate(laws):
        drift = Drift()
        for k in range(50, len(estimates.state)):
            if estimates.validity[k, axis] == Validity.OK:
                row = *estimates.state[k, axis::2][[0, 1, 3]], estimates.std[k, 6 + axis]
                drift = updated(drift, law, Sample(*map(float, row)), 0.01)
        found.append(drift)
    return found


def drifts_with(columns, ratio):
    """The observer believes friction levels that are `ratio` times the true ones."""
    laws = tuple(of_levels(f, ratio) for f in LAWS)
    return drifts(batch.run(setup_of(PROTOTYPE, *laws, SHIPPED), columns), laws)


def test_friction_that_is_as_calibrated_asks_for_nothing(excited):
    for drift, law in zip(drifts_with(excited, 1.0), LAWS, strict=True):
        assert abs(correlation(drift)) < 0.6
        assert abs(friction_error(drift)) < 0.01 * law.coulomb
        assert not asks_for_calibration(drift, law)


@pytest.mark.parametrize(
    ("file", "slope", "offset_nm"),
    [
        ({}, 0.0, 0.0),
        ({"friction_over_position": (OverPosition(0.4, 0.3), EVERYWHERE)}, -0.4, 0.0),
        ({"effort_offset": (1.0, 0.0)}, 0.0, -1.0),
    ],
)
def test_a_slope_or_an_offset_beyond_the_file_s_is_seen_and_its_own_is_none(
    excited, file, slope, offset_nm
):
    """The machine has neither: a file with one is off by it."""
    setup = setup_of(PROTOTYPE, *LAWS, SHIPPED._replace(**file))

    hip, slide = drifts(batch.run(setup, excited))

    assert slope_error(hip, HIP) == pytest.approx(slope, abs=0.08)
    assert is_sloped(hip, HIP, 0.1) is (slope != 0.0)
    assert not is_sloped(hip, HIP, 0.2)
    assert offset_error(hip) == pytest.approx(offset_nm, abs=0.1)
    assert is_offset(hip) is (offset_nm != 0.0)
    assert not asks_for_calibration(hip, HIP)
    assert not is_offset(slide)
    assert not is_sloped(slide, SLIDE_FRICTION, 0.1)


@pytest.mark.parametrize("ratio", [0.8, 0.9, 1.1, 1.2])
def test_levels_that_are_off_ask_for_calibration_and_say_by_how_much(excited, ratio):
    """observer.md, test 33: rho -0.98 and beyond for a tenth."""
    for drift, law in zip(drifts_with(excited, ratio), LAWS, strict=True):
        error = (1.0 - ratio) * law.coulomb
        assert correlation(drift) * math.copysign(1.0, error) < -0.9
        assert friction_error(drift) == pytest.approx(error, rel=0.25)
        assert asks_for_calibration(drift, law)


def test_a_patient_who_pushes_with_the_motion_looks_like_friction_that_is_too_low():
    """observer.md, fact 6: so advice is only for an empty machine."""
    cycles = 1500
    path = gait(PATIENT, np.arange(1, cycles + 1) * 0.01, 0.25)
    speed = np.gradient(path, 0.01, axis=0)

    def patient(t):
        return (
            3.0
            * np.tanh(np.interp(t, np.arange(cycles) * 0.01, speed[:, 0]) / 0.05)[:, None]
            * (1.0, 0.0)
        )

    truth = simulate(PATIENT, cycles, reference=path, start=path[0], patient=patient)
    estimates = batch.run(setup_of(PATIENT, *LAWS, SHIPPED), encoded(truth))

    hip = drifts(estimates)[0]
    assert friction_error(hip) == pytest.approx(-3.0, rel=0.15)
    assert correlation(hip) > 0.8


@pytest.mark.parametrize(
    ("along", "across", "expected"),
    [(1.1, 0.1, True), (-1.1, 0.1, True), (0.9, 0.1, False), (1.1, 1.0, False)],
)
def test_what_exceeds_the_law_itself_with_the_motion_is_no_friction(along, across, expected):
    """A patient of `along` times Coulomb friction with the motion, and `across` without it."""
    drift = Drift()
    for row in range(2000):
        sign = math.copysign(1.0, math.sin(row / 50.0))
        other = math.copysign(across, math.sin(row / 7.0))
        patient = (along * sign + other) * HIP.coulomb
        drift = updated(drift, HIP, Sample(0.0, sign, patient, 0.0), 0.01)

    assert is_no_friction(drift, HIP) is expected


def test_rest_and_slow_motion_count_for_nothing():
    drift = Drift()
    for speed in (0.0, HIP.edge, -CERTAIN_EDGES * HIP.edge):
        drift = updated(drift, HIP, Sample(0.0, speed, 5.0, 0.1), 0.01)

    assert drift == Drift()
    assert math.isnan(correlation(drift))
    assert math.isnan(friction_error(drift))
    assert math.isnan(offset_error(drift))
    assert math.isnan(slope_error(drift, HIP))
    assert not asks_for_calibration(drift, HIP)
    assert not is_offset(drift)
    assert not is_sloped(drift, HIP, 0.0)


def test_motion_in_one_direction_only_tells_nothing():
    drift = Drift()
    for _ in range(1000):
        drift = updated(drift, HIP, Sample(0.0, 0.5, -3.0, 0.1), 0.01)

    assert math.isnan(correlation(drift))


def test_old_motion_is_forgotten():
    """Friction that was wrong, and is right now: within two minutes of motion nothing is left."""

    def moved(drift, error, seconds):
        for k in range(int(seconds * 100)):
            speed = math.copysign(0.5, math.sin(2 * math.pi * k / 200))
            sample = Sample(0.0, speed, -math.copysign(error, speed), 0.1)
            drift = updated(drift, HIP, sample, 0.01)
        return drift

    drift = moved(Drift(), 1.0, 20.0)
    assert friction_error(drift) == pytest.approx(1.0, rel=0.01)
    assert abs(friction_error(moved(drift, 0.0, 120.0))) < 0.01
