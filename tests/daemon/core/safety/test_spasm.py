"""Spasms: what begins one, how long it lasts, and the stiffness in it."""

import math

import numpy as np
import pytest

from daemon.core.safety.spasm import STILL_CYCLES, SpasmRules, SpasmWatch, softened

RULES = SpasmRules(10, stiffness_ratio=0.3, softening_ratio=0.1, recovery_ratio=0.005)
RISE, REST = 14.0, 0.05


def lasting(efforts, *, speed=-0.5, wanted=0.0, needed=0.0, still=0):
    """How long a spasm has lasted after these efforts of the patient's, one a cycle."""
    watch = SpasmWatch(RULES.window_cycles)
    for effort in efforts:
        watch.update(effort, speed, wanted, needed, still, RISE, REST)
    return watch.cycles


def ramp(peak, cycles):
    return [0.0] * 12 + list(np.linspace(0.0, peak, cycles + 1))[1:]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_fast_rise_against_the_motion_is_a_spasm_and_at_its_limit_it_is_none(sign):
    assert lasting([sign * e for e in ramp(RISE + 0.01, 10)], speed=-sign) == 1
    assert lasting([sign * e for e in ramp(RISE, 10)], speed=-sign) == 0


def test_a_slow_rise_is_none():
    assert lasting(ramp(2 * RISE, 30)) == 0


def practised(share, need=RISE):
    """A watch after four seconds in which the patient gave this share of a changing need."""
    watch = SpasmWatch(RULES.window_cycles)
    for needed in [*(need * np.sin(np.linspace(0.0, 2 * np.pi, 400))).tolist(), *[0.0] * 12]:
        watch.update(share * needed, 0.0, 0.0, needed, 0, RISE, REST)
    assert watch.cycles == 0
    return watch


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("share", "needed", "cycles"),
    [
        (1.0, 1.2 * RISE, 0),
        (1.0, 0.6 * RISE, 1),
        (1.0, -1.2 * RISE, 1),  # a need along with the motion excuses no effort against it
        (0.5, 1.2 * RISE, 1),
        (0.0, 9.0 * RISE, 1),  # a passive patient brakes nothing
        (-1.0, -9.0 * RISE, 1),  # to resist is no work
        (1.4, 0.8 * RISE, 0),
        (3.0, 0.55 * RISE, 1),  # no patient gives three times the need
    ],
)
def test_a_share_of_the_need_that_the_patient_has_given_before_is_work(share, needed, cycles, sign):
    watch = practised(share)

    for effort in np.linspace(0.0, 1.9 * RISE, 11)[1:]:
        watch.update(sign * effort, -sign * 0.5, 0.0, sign * needed, 0, RISE, REST)

    assert (watch.cycles > 0) == bool(cycles)


def test_a_need_along_with_the_motion_makes_an_effort_no_larger():
    watch = practised(share=1.0)

    for effort in [-0.95 * RISE] * 11 + [0.95 * RISE]:
        watch.update(effort, -0.5, 0.0, -3.0 * RISE, 0, RISE, REST)

    assert watch.rise_si > RISE
    assert watch.cycles == 0


@pytest.mark.parametrize(
    ("effort", "needed"),
    [
        *((value, 1.0) for value in (math.nan, math.inf, -math.inf)),
        *((1.0, value) for value in (math.nan, math.inf, -math.inf)),
        *((1e200, 1e200), (1e200, -1e200)),  # their product is not finite
    ],
)
@pytest.mark.parametrize(("need", "is_spasm"), [(0.6 * RISE, True), (1.9 * RISE, False)])
def test_a_number_that_is_not_finite_hides_no_spasm_after_it_and_makes_none(
    effort, needed, need, is_spasm
):
    watch = practised(share=1.0)
    watch.update(effort, 0.0, 0.0, needed, 0, RISE, REST)

    for _ in range(RULES.window_cycles + 1):
        watch.update(0.0, -0.5, 0.0, 0.0, 0, RISE, REST)
    for rising in np.linspace(0.0, 1.9 * RISE, 11)[1:].tolist():
        watch.update(rising, -0.5, 0.0, need, 0, RISE, REST)

    assert (watch.cycles > 0) == is_spasm


def test_a_small_need_teaches_no_share():
    watch = practised(share=1.0, need=0.05 * RISE)

    for effort in np.linspace(0.0, 1.9 * RISE, 11)[1:]:
        watch.update(effort, -0.5, 0.0, 1.2 * RISE, 0, RISE, REST)

    assert watch.cycles > 0


def test_a_spasm_teaches_no_share_and_a_need_does_not_end_it():
    watch = practised(share=0.0)
    for effort in ramp(2 * RISE, 10):
        watch.update(effort, -0.5, 0.0, 2 * RISE, 0, RISE, REST)
    begun = watch.cycles

    watch.update(2 * RISE, -0.5, 0.0, 2 * RISE, 0, RISE, REST)

    assert watch.cycles == begun + 1 > 1


@pytest.mark.parametrize("is_reset", [False, True])
@pytest.mark.parametrize(("needed", "cycles"), [(1.062, 1), (1.063, 0)])
def test_a_share_is_learned_from_its_first_cycle_and_after_a_reset_as_well(
    needed, cycles, is_reset
):
    """One cycle with effort and need of 4: a share of 0.16 / (0.16 + 0.1**2), or 1 / 1.0625."""
    watch = SpasmWatch(1)
    if is_reset:
        for _ in range(100):
            watch.update(9.0, 1.0, 0.0, 9.0, 0, 1.0, REST)
        watch.reset()
    watch.update(4.0, 1.0, 0.0, 4.0, 0, 1.0, REST)
    watch.update(0.0, -1.0, 0.0, 0.0, 0, 1.0, REST)

    watch.update(2.0, -1.0, 0.0, needed, 0, 1.0, REST)

    assert watch.cycles == cycles


@pytest.mark.parametrize("motion", [{"speed": 0.5}, {"speed": -0.5, "wanted": 0.5}])
def test_a_push_along_with_the_motion_is_none(motion):
    assert lasting(ramp(2 * RISE, 10), **motion) == 0


def test_at_a_turn_of_the_gait_no_effort_is_along_with_the_motion():
    assert lasting(ramp(2 * RISE, 10), speed=0.9 * REST) > 0


def test_an_effort_that_is_let_go_is_no_spasm():
    assert lasting([2 * RISE] * 12 + ramp(0.0, 1)[12:] + [0.0] * 3, speed=0.5) == 0


def test_a_joint_that_gives_no_count_says_nothing_of_a_spasm():
    assert lasting(ramp(2 * RISE, 10), still=STILL_CYCLES - 1) > 0
    assert lasting(ramp(2 * RISE, 10), still=STILL_CYCLES) == 0


def test_a_spasm_lasts_until_half_of_its_rise_is_gone():
    risen = ramp(2 * RISE, 10)
    begun = lasting(risen)

    assert lasting([*risen, *[0.6 * RISE] * 50]) == begun + 50
    assert lasting([*risen, 0.4 * RISE]) == 0
    assert lasting([*risen, -2 * RISE]) == 0


def test_without_an_estimate_nothing_is_known_of_a_spasm():
    watch = SpasmWatch(RULES.window_cycles)
    for effort in ramp(2 * RISE, 10):
        watch.update(effort, -0.5, 0.0, 0.0, 0, RISE, REST)
    watch.reset()

    assert (watch.cycles, watch.rise_si) == (0, 0.0)


# Binary fractions: sums and products of them are exact, and none is as large as 1.
WINDOW, SMALL_RISE, SMALL_REST = 3, 0.25, 0.125
FLAT, BEGUN, LIFTED = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.5], [1.0, 1.0, 1.0, 1.5]


@pytest.mark.parametrize(
    ("efforts", "motion", "rise", "cycles"),
    [
        ([], (-1.0, 0.0, 0.0, 0), 0.0, 0),
        (BEGUN, (-1.0, 0.0, 0.0, 0), 0.5, 1),
        # the window is of so many cycles
        ([0.0, 0.25, 0.25, 0.375], (-1.0, 0.0, 0.0, 0), 0.375, 1),
        ([0.0, 0.125, 0.125, 0.125, 0.375], (-1.0, 0.0, 0.0, 0), 0.25, 0),
        # a stuck joint
        (BEGUN, (-1.0, 0.0, 0.0, 2), 0.5, 1),
        (BEGUN, (-1.0, 0.0, 0.0, 3), 0.5, 0),
        (BEGUN, (-1.0, 0.0, 0.0, 4), 0.5, 0),
        # along with the motion, or too slow to be
        (BEGUN, (0.125, 0.0, 0.0, 0), 0.5, 1),
        (BEGUN, (0.25, 0.0, 0.0, 0), 0.5, 0),
        (BEGUN, (1.0, 0.0, 0.0, 0), 0.5, 0),
        (BEGUN, (-0.25, 0.0, 0.0, 0), 0.5, 1),
        (BEGUN, (-1.0, 0.25, 0.0, 0), 0.5, 0),
        # an effort against the motion is let go
        ([-0.625, -0.625, -0.625, -0.125], (-1.0, 0.0, 0.0, 0), 0.5, 0),
        # an effort that rises to its threshold, from the other side
        ([-0.25, -0.25, -0.25, 0.25], (-1.0, 0.0, 0.0, 0), 0.5, 0),
        # half of the rise is left, counted from the effort before it
        ([*BEGUN, 0.126], (-1.0, 0.0, 0.0, 0), 0.5, 2),
        ([*BEGUN, 0.125], (-1.0, 0.0, 0.0, 0), 0.5, 0),
        ([*BEGUN, -0.2], (-1.0, 0.0, 0.0, 0), 0.5, 0),
        ([*LIFTED, 1.126], (-1.0, 0.0, 0.0, 0), 0.5, 2),
        ([*LIFTED, 1.125], (-1.0, 0.0, 0.0, 0), 0.5, 0),
        ([0.0, 0.0, 0.0, 6.0, -3.0], (-1.0, 0.0, 0.0, 0), 6.0, 0),
    ],
)
def test_what_begins_a_spasm_and_what_ends_it(efforts, motion, rise, cycles):
    watch = SpasmWatch(WINDOW)

    for effort in efforts:
        watch.update(effort, *motion, SMALL_RISE, SMALL_REST)

    assert (watch.rise_si, watch.cycles) == (rise, cycles)


def test_a_rise_across_a_reset_is_none():
    watch = SpasmWatch(WINDOW)
    for effort in FLAT:
        watch.update(effort, -1.0, 0.0, 0.0, 0, SMALL_RISE, SMALL_REST)
    watch.reset()

    watch.update(0.5, -1.0, 0.0, 0.0, 0, SMALL_RISE, SMALL_REST)

    assert (watch.rise_si, watch.cycles) == (0.0, 0)


@pytest.mark.parametrize(
    ("before", "in_spasm", "after"),
    [
        (1.0, True, 0.875),
        (0.5, True, 0.375),
        (0.3125, True, 0.25),
        (0.25, True, 0.25),
        (0.125, True, 0.125),
        (0.125, False, 0.1875),
        (0.5, False, 0.5625),
        (0.96875, False, 1.0),
        (1.0, False, 1.0),
    ],
)
def test_stiffness_falls_and_comes_back_by_rate_within_its_limits(before, in_spasm, after):
    rules = SpasmRules(WINDOW, 0.25, softening_ratio=0.125, recovery_ratio=0.0625)

    assert softened(before, rules, in_spasm=in_spasm) == after
