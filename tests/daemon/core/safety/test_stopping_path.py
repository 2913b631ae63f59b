"""Where a leg comes to rest: against the sweep of `gaitd check` and the mechanism itself."""

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from safety_inputs import slide_ends
from sessions import demo

from daemon.config.robot import leg_parameters
from daemon.core.safety.stopping_path import (
    REACTION_S,
    cosine,
    end_of,
    gradient,
    least_ratio,
    on_ramp,
    ratio_of,
    reaction_s,
)
from observer.mechanism.mechanism import singularity_ratio

LEG = leg_parameters(demo().robot)
RAMPS = (15.0, 20.0)
positions = st.tuples(st.floats(-0.5, 0.9), st.floats(-0.2, 1.2))
speeds = st.floats(-3.0, 3.0)


@settings(derandomize=True, deadline=None)
@given(position=positions)
def test_the_ratio_of_a_pose_is_that_of_the_mechanism(position):
    ours = ratio_of(cosine(LEG, position))

    theirs = float(singularity_ratio(LEG, np.array(position)))
    assume(theirs > 0.01 or ours == 0.0)
    assert ours == pytest.approx(theirs, abs=1e-9)


@settings(derandomize=True, deadline=None)
@given(position=st.floats(-1, 1), speed=speeds)
def test_an_axis_on_its_ramp_goes_on_for_the_reaction_and_then_brakes_to_its_end(position, speed):
    ramp = 15.0
    braking_s = abs(speed) / ramp

    assert on_ramp(position, speed, ramp, 0.0, REACTION_S) == position
    assert on_ramp(position, speed, ramp, REACTION_S, REACTION_S) == pytest.approx(
        position + speed * REACTION_S
    )
    end = end_of(position, speed, ramp, REACTION_S)
    assert on_ramp(position, speed, ramp, REACTION_S + braking_s, REACTION_S) == pytest.approx(end)
    assert on_ramp(position, speed, ramp, 10.0, REACTION_S) == pytest.approx(end)
    # By energy: the ramp takes away just the speed's.
    assert abs(end - position) - abs(speed) * REACTION_S == pytest.approx(speed**2 / (2 * ramp))


@settings(derandomize=True, deadline=None)
@given(position=positions, velocity=st.tuples(speeds, speeds), ramps=st.just(RAMPS))
@example(position=(0.3, 0.6), velocity=(0.5, 1.0), ramps=(20.0, 2.0))
@example(position=(0.3, 0.6), velocity=(0.5, -1.0), ramps=(20.0, 2.0))
def test_the_least_ratio_is_found_among_the_poses_on_the_way(position, velocity, ramps):
    whole_s = REACTION_S + max(abs(v) / a for v, a in zip(velocity, ramps, strict=True))

    def pose(time_s):
        times, reactions = (time_s, time_s), (REACTION_S, REACTION_S)
        return tuple(map(on_ramp, position, velocity, ramps, times, reactions))

    way = [pose(whole_s * k / 6) for k in range(7)]
    worst = min(float(singularity_ratio(LEG, np.array(one))) for one in way)
    assert least_ratio(LEG, position, velocity, ramps, REACTION_S) == pytest.approx(worst, abs=1e-6)


def test_the_least_ratio_of_a_leg_that_rests_is_that_of_its_pose():
    pose = (0.3, 0.6)

    least = least_ratio(LEG, pose, (0.0, 0.0), RAMPS, REACTION_S)

    assert least == pytest.approx(float(singularity_ratio(LEG, np.array(pose))))


def test_an_axis_that_goes_backwards_brakes_to_its_end():
    end = end_of(1.0, -3.0, 15.0, REACTION_S)

    assert end == pytest.approx(1.0 - 3.0 * REACTION_S - 0.3)
    assert on_ramp(1.0, -3.0, 15.0, 1.0, REACTION_S) == pytest.approx(end)


def test_the_gradient_is_that_of_the_ratio_down_to_a_hundredth_and_bounded_below_it():
    _, farthest = slide_ends(LEG, 0.0, 0.02)
    low, high = ((0.0, farthest + step) for step in (-1e-7, 1e-7))

    slope = (ratio_of(cosine(LEG, high)) - ratio_of(cosine(LEG, low))) / 2e-7

    assert gradient(LEG, (0.0, farthest))[1] == pytest.approx(slope, rel=1e-3)
    assert gradient(LEG, (0.0, farthest + 0.1))[1] < 0.0


def test_a_leg_under_assist_goes_on_for_three_cycles_and_else_for_one():
    assert reaction_s(assisted=True) == pytest.approx(0.03)
    assert reaction_s(assisted=False) == pytest.approx(0.01)
