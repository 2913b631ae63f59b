"""Position, speed and standstill of a joint from raw samples."""

import pytest
from safety_inputs import FEEDBACK, LIMITS, THRESHOLDS

from daemon.core.safety.joints import (
    STILL_COUNTS,
    Joint,
    is_at_rest,
    jump_reach_si,
    measure,
    still_counts_max,
)
from drives.cia402.units import AxisScaling

SCALING = AxisScaling(
    counts_per_si=-1000.0,
    offset_si=0.5,
    effort_per_torque_count_si=-0.1,
    permille_per_effort_si=1.0,
    target_limit_count=32767,
    speed_counts_per_si=1.0,
    deceleration_counts_per_si=1.0,
)
MS = 1_000_000


def sample(counts, torque_raw=0):
    return FEEDBACK._replace(position_counts=counts, torque_raw=torque_raw)


def measured(*counts, begin=Joint()):  # noqa: B008 - frozen
    """The joint after samples at equal times."""
    joint = begin
    for count in counts:
        joint = measure(joint, sample(count), SCALING, LIMITS, joint.sample_ns + 10 * MS)
    return joint


def test_before_the_first_sample_nothing_is_known_and_every_number_is_zero():
    assert Joint() == (False, False, *[0] * (len(Joint._fields) - 2))


def test_the_first_sample_gives_a_position_and_no_speed():
    assert measure(Joint(), sample(200, 30), SCALING, LIMITS, 7 * MS) == Joint(
        known=True,
        fresh=True,
        position_si=0.3,
        effort_si=-3.0,
        sample_ns=7 * MS,
        counts=200,
        still_counts=200,
    )


def test_the_speed_is_the_step_over_the_measured_time():
    first = measure(Joint(), sample(200), SCALING, LIMITS, 100 * MS)

    joint = measure(first, sample(150, -20), SCALING, LIMITS, 120 * MS)

    assert (joint.known, joint.fresh) == (True, True)
    assert joint.position_si == pytest.approx(0.35)
    assert joint.step_si == pytest.approx(0.05)
    assert joint.elapsed_s == pytest.approx(0.02)
    assert joint.velocity_si == pytest.approx(2.5)
    assert joint.effort_si == pytest.approx(2.0)
    assert (joint.sample_ns, joint.counts) == (120 * MS, 150)


def test_without_a_sample_everything_stays_and_nothing_is_fresh():
    before = measured(200, 150)

    joint = measure(before, sample(0)._replace(fresh=False), SCALING, LIMITS, 999 * MS)

    assert joint == before._replace(fresh=False)


@pytest.mark.parametrize("side", [-1, 1])
def test_noise_around_one_place_is_standstill_and_a_slow_motion_is_not(side):
    noise = measured(200, *(200 + side * STILL_COUNTS, 200 - side * STILL_COUNTS) * 2)
    creeping = measured(200, *(200 + side * k for k in range(1, 5)))

    assert (noise.still_cycles, noise.still_counts) == (4, 200)
    assert (creeping.still_cycles, creeping.still_counts) == (0, 200 + 4 * side)
    assert measured(204, begin=creeping).still_cycles == (1 if side > 0 else 0)


@pytest.mark.parametrize("sign", [-1, 1])
def test_standstill_is_as_wide_at_the_joint_with_a_fine_encoder_as_with_a_coarse_one(sign):
    """LIMITS has standstill below 0.02, so within 0.06e-3."""
    fine = SCALING._replace(counts_per_si=sign * 1e6)

    assert still_counts_max(SCALING, LIMITS) == STILL_COUNTS
    assert still_counts_max(fine, LIMITS) == 60
    joint = measure(Joint(), sample(0), fine, LIMITS, 10 * MS)
    assert measure(joint, sample(60), fine, LIMITS, 20 * MS).still_cycles == 1
    assert measure(joint, sample(61), fine, LIMITS, 20 * MS).still_cycles == 0


def test_the_speed_before_standstill_is_kept_until_the_joint_has_moved_again():
    moving = measured(200, 250, 300)
    assert moving.velocity_si == pytest.approx(-5.0)

    standing = measured(301, 302, 301, begin=moving)
    assert standing.still_cycles == 3
    assert standing.speed_before_still_si == pytest.approx(5.0)

    again = measured(320, 321, begin=standing)
    assert again.still_cycles == 1
    assert again.speed_before_still_si == pytest.approx(1.9)


def test_a_jump_reaches_as_far_as_the_fastest_joint_in_the_time_between_the_samples():
    joint = Joint(elapsed_s=0.02)

    assert jump_reach_si(joint, LIMITS, THRESHOLDS) == pytest.approx(1.5 * 3.0 * 0.02)


@pytest.mark.parametrize(
    ("velocity_si", "rests"),
    [(0.0, True), (0.0199, True), (-0.0199, True), (0.02, False), (-1, False)],
)
def test_a_joint_rests_below_the_limit_of_standstill_in_either_direction(velocity_si, rests):
    assert is_at_rest(Joint(velocity_si=velocity_si), LIMITS) is rests
