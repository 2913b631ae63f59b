"""The soft margins: what leads out is slowed, moving back is free, and nothing steps."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safety_inputs import THRESHOLDS, slide_ends
from sessions import demo

from daemon.config.robot import friction_parameters, leg_parameters
from daemon.core.safety import soft_limits
from daemon.core.safety.limits import hip_limits, slide_limits
from daemon.core.safety.soft_limits import SoftZone, slowed, zone_at
from daemon.core.safety.stopping_path import gradient
from observer.mechanism.mechanism import singularity_ratio

SETTINGS = demo()
LEG = leg_parameters(SETTINGS.robot)
FRICTION = friction_parameters(SETTINGS.robot)
LIMITS = (
    hip_limits(SETTINGS.limits, FRICTION[0].stribeck),
    slide_limits(SETTINGS.limits, FRICTION[1].stribeck),
)
LOAD = (5.0, -20.0)
MIDDLE = (0.2, 0.5)


def margin(axis, end, depth):
    """A position of one axis at a depth of its margin, the other one in the middle."""
    limits = LIMITS[axis]
    edge = limits.position_max_si if end > 0 else limits.position_min_si
    return edge - end * (1.0 - depth) * limits.soft_margin_si


def at(axis, end, depth):
    signed = end * depth
    return SoftZone((signed, 0.0) if axis == 0 else (0.0, signed))


def pair(axis, value):
    return (value, 0.0) if axis == 0 else (0.0, value)


def added(first, second):
    return tuple(a + b for a, b in zip(first, second, strict=True))


def after(zone, velocity, push, position=MIDDLE):
    """The push beyond the load that is left of one."""
    total = slowed(zone, LEG, LIMITS, position, velocity, LOAD, added(LOAD, push))
    return tuple(one - load for one, load in zip(total, LOAD, strict=True))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("end", [-1, 1])
def test_a_margin_begins_with_nothing_and_is_full_at_the_hard_limit(axis, end):
    def depth(share):
        pose = list(MIDDLE)
        pose[axis] = margin(axis, end, share)
        return zone_at(LIMITS, THRESHOLDS, tuple(pose), 0.8).depth[axis]

    assert depth(-0.1) == 0.0
    assert depth(0.5) == pytest.approx(end * 0.5)
    assert depth(1.0) == pytest.approx(end)
    assert depth(1.5) == pytest.approx(end)


@pytest.mark.parametrize(
    ("ratio", "depth"), [(0.31, 0.0), (0.3, 0.0), (0.225, 0.5), (0.15, 1.0), (0.0, 1.0)]
)
def test_the_mechanisms_margin_lies_between_its_soft_and_its_stop_ratio(ratio, depth):
    zone = zone_at(LIMITS, THRESHOLDS, MIDDLE, ratio)

    assert zone.mechanism_depth_ratio == pytest.approx(depth)
    assert zone.entered == (depth > 0)


def test_outside_of_all_margins_guidance_gets_just_what_it_wants():
    wanted = (math.pi, -math.e)

    assert SoftZone() == ((0.0, 0.0), 0.0)
    assert slowed(SoftZone(), LEG, LIMITS, MIDDLE, (1.0, 1.0), LOAD, wanted) == wanted


# Binary fractions: sums and products of them are exact.
ROUND = LIMITS[0]._replace(
    position_min_si=-1.0, position_max_si=2.0, soft_margin_si=0.5, soft_damping_si=0.75
)
OTHER = ROUND._replace(position_max_si=3.0, soft_margin_si=0.25, soft_damping_si=2.0)


@pytest.mark.parametrize(
    ("position_si", "depths"),
    [
        (-3.0, (-1.0, -1.0)),
        (-1.0, (-1.0, -1.0)),
        (-0.875, (-0.75, -0.5)),
        (-0.5, (0.0, 0.0)),
        (0.5, (0.0, 0.0)),
        (1.5, (0.0, 0.0)),
        (1.75, (0.5, 0.0)),
        (2.0, (1.0, 0.0)),
        (2.875, (1.0, 0.5)),
        (9.0, (1.0, 1.0)),
    ],
)
def test_a_depth_is_the_share_of_the_margin_and_negative_at_the_lower_end(position_si, depths):
    for axis, limits in enumerate((ROUND, OTHER)):
        pose = (position_si, 0.5) if axis == 0 else (0.5, position_si)
        both = (limits, ROUND) if axis == 0 else (ROUND, limits)

        zone = zone_at(both, THRESHOLDS, pose, 0.8)

        assert zone == SoftZone(pair(axis, depths[axis]), 0.0)
        assert zone.entered == (depths[axis] != 0.0)


@pytest.mark.parametrize(
    ("depth", "speed", "push", "left"),
    [
        (0.5, 0.0, 8.0, 4.0),
        (0.5, 0.0, -8.0, -8.0),
        (-0.25, 0.0, -8.0, -6.0),
        (-0.25, 0.0, 8.0, 8.0),
        (0.5, 2.0, 0.0, -1.0),
        (0.5, -2.0, 0.0, 0.0),
        (-0.5, -2.0, 0.0, 1.0),
        (-0.5, 2.0, 0.0, 0.0),
        (0.25, 0.5, 0.5, 0.25),
        (0.25, -0.5, 0.5, 0.375),
        (0.25, 0.5, -0.5, -0.625),
        (0.25, -0.5, -0.5, -0.5),
    ],
)
@pytest.mark.parametrize("axis", [0, 1])
def test_what_leads_out_is_reduced_and_motion_out_is_damped_by_the_depth(
    axis, depth, speed, push, left
):
    def with_damping(damping_si):
        limits = [ROUND._replace(soft_damping_si=64.0), OTHER._replace(soft_damping_si=64.0)]
        limits[axis] = limits[axis]._replace(soft_damping_si=damping_si)
        wanted = added(LOAD, pair(axis, push))
        zone = SoftZone(pair(axis, depth))
        return slowed(zone, LEG, tuple(limits), MIDDLE, pair(axis, speed), LOAD, wanted)

    assert with_damping(1.0) == added(LOAD, pair(axis, left))
    more = -abs(depth) * speed if depth * speed > 0 else 0.0
    assert with_damping(2.0) == added(LOAD, pair(axis, left + more))


@pytest.mark.parametrize(
    ("dampings", "depth", "velocity", "push", "back"),
    [
        # inwards is (3, 4): the push leads out by 3, then by the slide, then inwards
        ((1.0, 2.0), 1.0, (0.0, 0.0), (-17.0, 0.0), 3.0),
        ((1.0, 2.0), 0.5, (0.0, 0.0), (0.0, -17.0), 1.0),
        ((1.0, 2.0), 0.5, (0.0, 0.0), (17.0, 0.0), 0.0),
        ((1.0, 2.0), 1.0, (0.0, 0.0), (-0.5, 0.125), 1.25 / 17.0),
        # motion, with less than one and more than one of speed
        ((1.0, 2.0), 0.5, (-17.0, 0.0), (0.0, 0.0), 1.5),
        ((1.0, 2.0), 0.5, (0.0, -17.0), (0.0, 0.0), 2.0),
        ((1.0, 2.0), 0.5, (0.0, -0.5), (0.0, 0.0), 1.0 / 17.0),
        ((1.0, 2.0), 0.5, (17.0, 17.0), (0.0, 0.0), 0.0),
        # both; one of them inwards takes nothing from the other
        ((1.0, 2.0), 1.0, (-17.0, 0.0), (-17.0, 0.0), 6.0),
        ((1.0, 2.0), 1.0, (17.0, 0.0), (-17.0, 0.0), 3.0),
        ((1.0, 2.0), 1.0, (-17.0, 0.0), (17.0, 0.0), 3.0),
        # without damping
        ((0.0, 0.0), 1.0, (0.0, 0.0), (-25.0, 0.0), 3.0),
        ((0.0, 0.0), 1.0, (0.0, 0.0), (0.0, -25.0), 4.0),
        ((0.0, 1.0), 1.0, (-9016.0, 0.0), (0.0, 0.0), 3.0),
        ((1.0, 0.0), 1.0, (0.0, -16009.0), (0.0, 0.0), 4.0),
    ],
)
def test_near_the_singularity_the_part_that_leads_out_comes_back_along_the_gradient(
    monkeypatch, dampings, depth, velocity, push, back
):
    asked = []
    monkeypatch.setattr(soft_limits, "gradient", lambda *at: asked.append(at) or (3.0, 4.0))
    limits = tuple(LIMITS[axis]._replace(soft_damping_si=dampings[axis]) for axis in (0, 1))

    zone = SoftZone(mechanism_depth_ratio=depth)
    total = slowed(zone, LEG, limits, MIDDLE, velocity, LOAD, added(LOAD, push))

    assert zone.entered
    assert asked == [(LEG, MIDDLE)]
    expected = added(LOAD, added(push, (3.0 * back, 4.0 * back)))
    assert total == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_leg_in_a_margin_of_one_axis_needs_no_gradient(monkeypatch):
    monkeypatch.setattr(soft_limits, "gradient", None)

    assert after(at(0, 1, 0.5), (0.0, 0.0), (8.0, 3.0)) == pytest.approx((4.0, 3.0))


speeds = st.floats(-3.0, 3.0)
pushes = st.floats(-60.0, 60.0)
depths = st.floats(0.0, 1.0)
axes = st.sampled_from([0, 1])
ends = st.sampled_from([-1, 1])


@settings(derandomize=True, deadline=None)
@given(axis=axes, end=ends, depth=depths, speed=speeds, push=pushes)
def test_no_axis_is_pushed_further_out_than_was_wanted_nor_held_back_on_its_way_in(
    axis, end, depth, speed, push
):
    left = after(at(axis, end, depth), pair(axis, speed), pair(axis, push))[axis]

    assert end * left <= end * push + 1e-9 or end * push < 0
    if end * speed <= 0 and end * push <= 0:
        assert left == pytest.approx(push)
    if depth == 1.0:
        assert end * left <= 1e-9
    # What is added takes energy out, or none.
    if end * push <= 0:
        assert (left - push) * speed <= 1e-9


@settings(derandomize=True, deadline=None)
@given(axis=axes, end=ends, depth=depths, speed=speeds, push=pushes)
def test_an_effort_that_is_slowed_is_bounded_by_what_was_wanted_and_the_damping(
    axis, end, depth, speed, push
):
    left = after(at(axis, end, depth), pair(axis, speed), pair(axis, push))[axis]

    assert abs(left) <= abs(push) + LIMITS[axis].soft_damping_si * abs(speed) + 1e-9


@settings(derandomize=True, deadline=None)
@given(axis=axes, end=ends, depth=depths, speed=speeds, push=pushes)
def test_a_small_step_of_pose_speed_or_wish_is_a_small_step_of_effort(
    axis, end, depth, speed, push
):
    small = 1e-6
    here = after(at(axis, end, depth), pair(axis, speed), pair(axis, push))[axis]

    for zone, velocity, wish in (
        (at(axis, end, max(depth - small, 0.0)), speed, push),
        (at(axis, end, depth), speed + small, push),
        (at(axis, end, depth), speed, push + small),
    ):
        there = after(zone, pair(axis, velocity), pair(axis, wish))[axis]
        assert abs(there - here) <= small * (LIMITS[axis].soft_damping_si * 4 + abs(push) + 2)


def pose_of(hip, ratio, end):
    """A pose with this singularity ratio, with the shank stretched or folded over the shoe."""
    return hip, slide_ends(LEG, hip, ratio)[end]


poses = st.builds(pose_of, st.floats(-0.3, 0.65), st.floats(0.12, 0.9), ends.map(lambda e: e > 0))


@settings(derandomize=True, deadline=None)
@given(position=poses)
def test_the_gradient_is_that_of_the_mechanisms_own_singularity_ratio(position):
    step = 1e-6
    verdicts = gradient(LEG, position)

    for axis in (0, 1):
        ahead, behind = np.array(position), np.array(position)
        ahead[axis] += step
        behind[axis] -= step
        slope = (singularity_ratio(LEG, ahead) - singularity_ratio(LEG, behind)) / (2 * step)
        assert verdicts[axis] == pytest.approx(slope, rel=1e-4, abs=1e-6)


@settings(derandomize=True, deadline=None)
@given(
    position=poses,
    depth=depths,
    velocity=st.tuples(speeds, speeds),
    push=st.tuples(pushes, pushes),
)
def test_near_the_singularity_both_axes_together_are_led_no_further_out(
    position, depth, velocity, push
):
    inwards = np.array(gradient(LEG, position))
    dampings = np.array([limits.soft_damping_si for limits in LIMITS])
    zone = SoftZone(mechanism_depth_ratio=depth)

    left = np.array(after(zone, velocity, push, position))

    added_push = left - np.array(push)
    outwards, speed_out = -inwards @ (np.array(push) / dampings), -inwards @ np.array(velocity)
    # Only along the gradient, only inwards, and nothing where all goes inwards already.
    assert added_push @ inwards >= -1e-9
    assert abs(added_push[0] * inwards[1] - added_push[1] * inwards[0]) <= 1e-6
    if outwards <= 0 and speed_out <= 0:
        assert np.allclose(left, push)
    elif outwards <= 0:
        assert added_push @ np.array(velocity) <= 1e-9
    if depth == 1.0 and speed_out <= 0:
        assert -inwards @ (left / dampings) <= 1e-6 * np.abs(left).max() + 1e-9


def test_a_wish_that_is_no_number_stays_none_and_stops_the_machine():
    wanted = (math.nan, 0.0)

    left = slowed(at(0, 1, 0.5), LEG, LIMITS, MIDDLE, (1.0, 0.0), LOAD, wanted)

    assert math.isnan(left[0])
