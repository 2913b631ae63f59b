"""What a robot file says of the drives' offset and of friction along an axis is taken off."""

import numpy as np
import pytest

from observer.filter.leg_observer import TuningError, check_tuning, setup_of
from observer.mechanism.friction import OverPosition, at_position
from observer.offline.batch import Columns, run
from tests.observer.trainer import HIP, PATIENT, SLIDE_FRICTION, TUNING, encoded, gait, simulate

SHIPPED = TUNING._replace(velocity_gated=True, patient_noise_max_ratio=20.0)


def test_friction_at_a_position_has_other_levels_and_the_same_speeds():
    over = OverPosition(0.5, 0.2)

    assert at_position(HIP, over, 0.2) == HIP
    assert at_position(HIP, over, 0.4) == HIP._replace(
        stribeck=pytest.approx(1.1 * HIP.stribeck), coulomb=pytest.approx(1.1 * HIP.coulomb)
    )
    assert at_position(HIP, over, -9.0).coulomb == pytest.approx(0.2 * HIP.coulomb)


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
