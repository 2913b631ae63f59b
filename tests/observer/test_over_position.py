"""What a robot file says of the drives' offset and of friction along an axis is taken off."""

import numpy as np
import pytest

from observer.filter.leg_observer import TuningError, check_tuning, setup_of
from observer.mechanism.friction import OverPosition, at_position, smallest_stribeck
from observer.offline.batch import Columns, run
from tests.observer.trainer import HIP, PATIENT, SLIDE_FRICTION, TUNING, encoded, gait, simulate

SHIPPED = TUNING._replace(velocity_gated=True, patient_noise_max_ratio=20.0)


def test_friction_at_a_position_has_other_levels_and_the_same_speeds():
    over = OverPosition(0.5, 0.2)

    assert at_position(HIP, over, 0.2) == HIP
    higher = at_position(HIP, over, 0.4)
    assert higher == HIP._replace(
        stribeck=pytest.approx(1.1 * HIP.stribeck - 0.1 * HIP.viscous * HIP.peak),
        coulomb=pytest.approx(1.1 * HIP.coulomb),
    )
    hump = HIP.stribeck - smallest_stribeck(HIP)
    assert higher.stribeck - smallest_stribeck(higher) == pytest.approx(1.1 * hump)
    assert at_position(HIP, over, -9.0).coulomb == pytest.approx(0.5 * HIP.coulomb)
    assert at_position(HIP, over, 9.0).coulomb == pytest.approx(1.5 * HIP.coulomb)


def test_friction_that_is_too_steep_at_an_end_of_the_axis_is_refused():
    steep = HIP._replace(coulomb=18.0, stribeck=20.3, edge=0.001)
    single, rising = TUNING._replace(substeps=1), OverPosition(0.1, 0.2)
    along = single._replace(friction_over_position=(rising, rising))

    check_tuning(PATIENT, steep, SLIDE_FRICTION, single)
    check_tuning(PATIENT, HIP, SLIDE_FRICTION, along)
    with pytest.raises(TuningError, match="this friction needs 2 at least"):
        check_tuning(PATIENT, steep, SLIDE_FRICTION, along)


@pytest.fixture(scope="module")
def walk():
    times = (np.arange(800) + 1) * 0.01
    return encoded(simulate(PATIENT, 800, reference=gait(PATIENT, times, 0.25)))


def test_an_offset_that_the_file_has_is_no_patient(walk):
    offset = np.array([1.0, -8.0])
    shown = Columns(walk.time_s, walk.position, walk.effort + offset)
    known = SHIPPED._replace(effort_offset=tuple(offset))

    right = run(setup_of(PATIENT, HIP, SLIDE_FRICTION, SHIPPED), walk)
    seen = run(setup_of(PATIENT, HIP, SLIDE_FRICTION, known), shown)

    np.testing.assert_allclose(seen.state, right.state, atol=1e-9)


def test_an_offset_that_is_no_number_is_refused():
    tuning = TUNING._replace(effort_offset=(float("nan"), 0.0))
    with pytest.raises(TuningError, match="effort_offset of the hip = nan"):
        check_tuning(PATIENT, HIP, SLIDE_FRICTION, tuning)
