"""What innovations show beyond the filter's covariance: jerks that it cannot follow, and a walk."""

import numpy as np
import pytest

from observer.filter.considered import Drives, Variant
from observer.filter.leg_observer import setup_of
from observer.filter.status import Validity
from observer.offline.batch import run
from observer.offline.smooth_batch import run_smoothed
from tests.observer.trainer import (
    HIP,
    PATIENT,
    SLIDE_FRICTION,
    TUNING,
    encoded,
    gait,
    rms,
    simulate,
)

SHIPPED = TUNING._replace(velocity_gated=True, patient_noise_max_ratio=20.0)
ALMOST_SURE = Variant(PATIENT, HIP, SLIDE_FRICTION, Drives(effort_offset_hip_nm=1e-9))
"""Without a parameter that is not sure, sigma is the filter's alone."""
CYCLES = 1600
SETTLED_S = 4.0
JERK_NM = 30.0
JERK_HZ = 20.0
JERK_FADES_S = 0.1


def active(time_s):
    return np.column_stack(
        (6.0 * np.sin(np.pi * time_s / 2.0), 30.0 * np.cos(np.pi * time_s / 2.0))
    )


def jerky(time_s):
    """A swing at the hip once a second, as of a shaft against its joint."""
    since_s = np.mod(time_s, 1.0)
    swing = np.exp(-since_s / JERK_FADES_S) * np.sin(2.0 * np.pi * JERK_HZ * since_s)
    return active(time_s) + np.column_stack((JERK_NM * swing, 0.0 * swing))


def walked(patient):
    path = gait(PATIENT, (np.arange(CYCLES) + 1) * 0.01, 0.25)
    return simulate(PATIENT, CYCLES, reference=path, patient=patient)


def seen(truth, variants, estimates_of=run):
    """Errors of the patient and their sigma, where both axes are valid."""
    setup = setup_of(PATIENT, HIP, SLIDE_FRICTION, SHIPPED, variants)
    found = estimates_of(setup, encoded(truth))
    rows = (truth.time_s > SETTLED_S) & (found.validity == Validity.OK).all(axis=1)
    return (found.state - truth.state)[rows, 6:8], found.std[rows, 6:8]


@pytest.mark.parametrize("estimates_of", [run, run_smoothed])
def test_sigma_holds_swings_that_the_filter_cannot_follow(estimates_of):
    truth = walked(jerky)

    for variants, missed_min, missed_max in (((), 0.1, 1.0), ([ALMOST_SURE], 0.0, 0.025)):
        error, std = (values[:, 0] for values in seen(truth, variants, estimates_of))
        assert missed_min <= np.mean(np.abs(error) > 3.0 * std) <= missed_max
        assert rms(std) < 1.1 * rms(error)


def test_sigma_of_a_machine_that_is_as_its_file_says_is_as_it_was():
    truth = walked(active)
    (_, own), (_, wide) = seen(truth, ()), seen(truth, [ALMOST_SURE])

    assert np.mean(wide > 1.001 * own) < 0.005
    assert rms(wide) == pytest.approx(rms(own), rel=1e-3)
