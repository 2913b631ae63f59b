"""What is not known of the machine: its share of sigma, beside observers that have the error."""

import numpy as np
import pytest

from observer.filter.considered import VARIANTS_MAX, Drives, Slopes, Variant, table_of
from observer.filter.leg_observer import setup_of, with_baseline
from observer.filter.status import Validity
from observer.mechanism.friction import OverPosition
from observer.offline.batch import Columns, run
from observer.offline.smooth_batch import run_smoothed
from observer.strides import strides_of
from tests.observer.trainer import (
    ENTIRE,
    HIP,
    PATIENT,
    SLIDE_FRICTION,
    TUNING,
    active,
    encoded,
    gait,
    rms,
    simulate,
)

SHIPPED = TUNING._replace(velocity_gated=True, patient_noise_max_ratio=20.0)
SETTLED_S = 4.0
PLACES = {
    (row, column): row * (row + 1) // 2 + column for row in range(8) for column in range(row + 1)
}
OWN = Variant(PATIENT, HIP, SLIDE_FRICTION)
OTHERS = {
    "a heavier thigh": Variant(
        PATIENT._replace(thigh_moment_re=1.05 * PATIENT.thigh_moment_re), HIP, SLIDE_FRICTION
    ),
    "a stiffer hip spring": Variant(
        PATIENT._replace(hip_stiffness=1.05 * PATIENT.hip_stiffness), HIP, SLIDE_FRICTION
    ),
    "a trunk that reclines by 0.01 rad more": Variant(
        PATIENT._replace(thigh_angle_rad=PATIENT.thigh_angle_rad + 0.01), HIP, SLIDE_FRICTION
    ),
    "a rail 10 mm higher": Variant(
        PATIENT._replace(rail_y_m=PATIENT.rail_y_m + 0.01), HIP, SLIDE_FRICTION
    ),
    "more friction at the hip": Variant(
        PATIENT,
        HIP._replace(stribeck=1.2 * HIP.stribeck, coulomb=1.2 * HIP.coulomb),
        SLIDE_FRICTION,
    ),
    "more viscous friction at the slide": Variant(
        PATIENT, HIP, SLIDE_FRICTION._replace(viscous=1.2 * SLIDE_FRICTION.viscous)
    ),
    "a torque constant too small": Variant(
        PATIENT, HIP, SLIDE_FRICTION, Drives(effort_ratio_hip=1.05)
    ),
    "a force sensor with an offset": Variant(
        PATIENT, HIP, SLIDE_FRICTION, Drives(effort_offset_slide_n=5.0)
    ),
    "an encoder with an offset": Variant(
        PATIENT, HIP, SLIDE_FRICTION, Drives(position_offset_hip_rad=0.01)
    ),
    "friction that rises along the slide": Variant(
        PATIENT, HIP, SLIDE_FRICTION, slopes=Slopes(slide_per_m=0.5)
    ),
}


@pytest.fixture(scope="module")
def walk():
    """Sixteen seconds of gait at 0.25 Hz with a patient who works, as a master records them."""
    times = (np.arange(1600) + 1) * 0.01
    return encoded(simulate(PATIENT, 1600, reference=gait(PATIENT, times, 0.25), patient=active))


def seen_by(variant: Variant, columns: Columns, estimates_of=run_smoothed):
    """The estimate of an observer that has this physics."""
    shown = np.array(variant.drives).reshape(3, 2)
    columns = Columns(
        columns.time_s, columns.position + shown[2], columns.effort * shown[0] + shown[1]
    )
    over = tuple(OverPosition(slope, 0.0) for slope in variant.slopes)
    tuning = SHIPPED._replace(friction_over_position=over)
    return estimates_of(setup_of(*variant[:3], tuning), columns)


def setup_with(*variants: Variant):
    return setup_of(PATIENT, HIP, SLIDE_FRICTION, SHIPPED, variants)


def following(*estimates):
    """Rows of the walk in which all splits have been valid for three T1.

    Before that an error of a rest is left, which sigma of the split holds and no derivative does.
    """
    valid = np.all([one.validity == Validity.OK for one in estimates], axis=(0, 2))
    rows = np.all([np.roll(valid, ago) for ago in range(7)], axis=0)
    return rows & (np.arange(len(rows)) * 0.01 > SETTLED_S)


@pytest.mark.parametrize("estimates_of", [run, run_smoothed])
@pytest.mark.parametrize("name", OTHERS)
def test_the_error_of_a_parameter_is_that_of_an_observer_that_has_it(walk, name, estimates_of):
    other = OTHERS[name]
    setup = setup_with(other)
    right, wrong = estimates_of(setup, walk), seen_by(other, walk, estimates_of)

    rows = following(right)
    told = (right.state - estimates_of(with_baseline(setup, ENTIRE), walk).state)[rows, 6:8]
    found = (wrong.state - right.state)[rows, 6:8]
    assert (rms(found - told) < 0.05 * rms(told) + (0.01, 0.015)).all()
    assert (rms(told) > (0.2, 1.0)).any()


@pytest.mark.parametrize("estimates_of", [run, run_smoothed])
@pytest.mark.parametrize("name", OTHERS)
def test_as_soon_as_a_split_is_valid_sigma_holds_the_error_of_a_parameter(walk, name, estimates_of):
    other = OTHERS[name]
    told = estimates_of(setup_with(other), walk)
    found = np.abs(seen_by(other, walk, estimates_of).state - told.state)

    for axis in range(2):
        valid = (walk.time_s > SETTLED_S) & (told.validity[:, axis] == Validity.OK)
        for state in (4 + axis, 6 + axis):
            assert (found[valid, state] <= 3.0 * told.std[valid, state]).mean() > 0.99


def test_the_filter_holds_the_error_as_its_smoother_does(walk):
    own, wide = run(setup_with(), walk), run(setup_with(*OTHERS.values()), walk)
    smooth = run_smoothed(setup_with(*OTHERS.values()), walk)

    rows = walk.time_s > SETTLED_S
    added = (wide.std**2 - own.std**2)[rows, 6:8]
    errors = smooth.unsure.reshape(len(walk.time_s), VARIANTS_MAX, 2)[rows]
    np.testing.assert_allclose(added.mean(axis=0), (errors**2).sum(axis=1).mean(axis=0), rtol=0.1)


@pytest.mark.parametrize("estimates_of", [run, run_smoothed])
def test_what_is_not_sure_widens_sigma_of_friction_patient_and_net_and_nothing_else(
    walk, estimates_of
):
    own = estimates_of(setup_with(), walk)
    wide = estimates_of(setup_with(*OTHERS.values()), walk)

    for name in ("state", "innovation", "nis", "net", "status", "validity"):
        np.testing.assert_array_equal(getattr(wide, name), getattr(own, name))
    # The lower triangle's first ten places are positions and velocities.
    np.testing.assert_array_equal(wide.covariance[:, :10], own.covariance[:, :10])
    np.testing.assert_array_equal(wide.std[:, :4], own.std[:, :4])
    moving = walk.time_s > SETTLED_S
    assert (wide.std[moving, 4:] > own.std[moving, 4:]).all()
    assert (wide.net_std[moving] > own.net_std[moving]).all()


def test_sigma_is_the_root_of_the_filters_own_and_all_errors_squared(walk):
    almost_sure = OWN._replace(drives=Drives(effort_offset_hip_nm=1e-9))
    own, wide = (run_smoothed(setup_with(*some), walk) for some in ([almost_sure], OTHERS.values()))

    errors = wide.unsure.reshape(len(walk.time_s), VARIANTS_MAX, 2)
    expected = np.sqrt(own.std[:, 6:8] ** 2 + (errors**2).sum(axis=1))
    np.testing.assert_allclose(wide.std[:, 6:8], expected, rtol=1e-9)
    together = own.covariance[:, PLACES[7, 6]] + (errors[..., 0] * errors[..., 1]).sum(axis=1)
    np.testing.assert_allclose(wide.covariance[:, PLACES[7, 6]], together, rtol=1e-9, atol=1e-9)


def test_net_is_as_sure_as_its_parts_together(walk):
    wide = run_smoothed(setup_with(*OTHERS.values()), walk)

    moving = (walk.time_s > SETTLED_S) & (wide.validity == Validity.OK).all(axis=1)
    for axis in range(2):
        friction, patient = 4 + axis, 6 + axis
        variance = wide.std[:, patient] ** 2 + wide.std[:, friction] ** 2
        variance -= 2.0 * wide.covariance[:, PLACES[patient, friction]]
        np.testing.assert_allclose(variance[moving], wide.net_std[moving, axis] ** 2, rtol=1e-6)


def test_after_a_reversal_net_holds_what_the_patient_has_not_taken_up_of_an_error_of_friction(walk):
    other = OTHERS["more friction at the hip"]
    right, wide = run(setup_with(), walk), run(setup_with(other), walk)
    wrong = run(setup_of(*other[:3], SHIPPED), walk)

    rows = following(right, wrong)
    for found, told, close in (
        (wrong.state[:, 6] - right.state[:, 6], wide.std[:, 6] ** 2 - right.std[:, 6] ** 2, 0.03),
        (
            wrong.net[:, 0] - right.net[:, 0],
            wide.net_std[:, 0] ** 2 - right.net_std[:, 0] ** 2,
            0.5,
        ),
    ):
        size, added = np.abs(found[rows]), np.sqrt(np.maximum(told[rows], 0.0))
        assert rms(added) == pytest.approx(rms(size), rel=0.1)
        assert rms(added - size) < close * rms(size)


def test_the_work_of_a_stride_is_wrong_by_what_its_sigma_says_of_a_parameter(walk):
    other = Variant(PATIENT, HIP, SLIDE_FRICTION, Drives(effort_offset_slide_n=1.0))
    own = strides_of(run_smoothed(setup_with(), walk), walk)
    wide = strides_of(run_smoothed(setup_with(other), walk), walk)
    wrong = strides_of(seen_by(other, walk), walk)

    assert len(own) > 1
    for (_, right), (_, told), (_, off) in zip(own, wide, wrong, strict=True):
        for name in ("work_positive_j", "work_negative_j", "assist_mean", "power_mean_w"):
            std = f"{name}_std"
            by_parameter = np.sqrt(getattr(told.slide, std) ** 2 - getattr(right.slide, std) ** 2)
            found = abs(getattr(off.slide, name) - getattr(right.slide, name))
            assert found == pytest.approx(by_parameter, rel=0.1, abs=0.02)


def test_an_error_of_both_axes_is_added_up_before_it_is_squared(walk):
    heavier = PATIENT._replace(shank_moment_re=1.1 * PATIENT.shank_moment_re)
    own = strides_of(run_smoothed(setup_with(), walk), walk)
    wide = strides_of(run_smoothed(setup_with(Variant(heavier, HIP, SLIDE_FRICTION)), walk), walk)

    for (_, right), (_, told) in zip(own, wide, strict=True):
        hip, slide, both = (
            np.sqrt(after.work_negative_j_std**2 - before.work_negative_j_std**2)
            for after, before in ((told.hip, right.hip), (told.slide, right.slide), (told, right))
        )
        # A heavier shank resists at one axis as it helps at the other.
        assert min(hip, slide) > 0.5
        assert both == pytest.approx(abs(hip - slide), rel=0.05)


def test_there_is_room_for_a_fixed_number_of_parameters():
    one = OTHERS["a heavier thigh"]

    assert np.count_nonzero(table_of(OWN, [one] * VARIANTS_MAX).any(axis=1)) == VARIANTS_MAX
    with pytest.raises(ValueError, match=f"there is room for {VARIANTS_MAX}"):
        table_of(OWN, [one] * (VARIANTS_MAX + 1))


def test_sigma_of_friction_holds_what_a_cycle_changes_of_its_known_error(walk):
    setup = setup_with(OTHERS["more friction at the hip"])
    plain, told = run(setup, walk), run(with_baseline(setup, ENTIRE), walk)
    none = run(with_baseline(setup, ENTIRE._replace(theta=0.0 * ENTIRE.theta)), walk)

    known = np.nan_to_num((plain.state - told.state)[:, 4:6])
    expected = np.zeros_like(known)
    for row in range(1, len(known)):
        change = known[row] - known[row - 1]
        expected[row] = expected[row - 1] * np.exp(-1 / 3) + change**2 * (1 - np.exp(-1 / 3))
    of_friction = (told.std**2 - none.std**2)[:, 4:6]
    of_net = told.net_std**2 - none.net_std**2
    rows = walk.time_s > SETTLED_S
    np.testing.assert_allclose(of_friction[rows], expected[rows], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(of_net[rows], expected[rows], rtol=1e-6, atol=1e-9)
    assert np.array_equal(told.std[:, 6:8], none.std[:, 6:8], equal_nan=True)
    assert expected[rows, 0].max() > 0.02


@pytest.mark.parametrize("estimates_of", [run, run_smoothed])
def test_where_friction_turns_sigma_holds_what_a_baseline_leaves_of_its_error(walk, estimates_of):
    more = SLIDE_FRICTION._replace(
        stribeck=1.25 * SLIDE_FRICTION.stribeck, coulomb=1.25 * SLIDE_FRICTION.coulomb
    )
    setup = with_baseline(
        setup_of(PATIENT, HIP, more, SHIPPED, [OWN]), ENTIRE._replace(theta=-ENTIRE.theta)
    )
    told, right = estimates_of(setup, walk), seen_by(OWN, walk, estimates_of)

    rows = following(told)
    error = np.abs(told.state - right.state)[rows, 5]
    assert (error <= 3.0 * told.std[rows, 5]).mean() > 0.995
