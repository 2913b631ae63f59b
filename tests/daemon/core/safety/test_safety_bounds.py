"""The laws of what may be sent: bounds on effort, assist and position, by differentiating them."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safety_inputs import LIMITS

from daemon.core.safety.bounds import bound, bound_assist

DT_S = 0.01
STEP_SI = LIMITS.assist_rate_max_si_per_s * DT_S
MAX_SI, POWER_W = LIMITS.assist_max_si, LIMITS.assist_power_max_w
NEAR = 1e-9
BAD = (math.nan, math.inf, -math.inf)

wishes = st.floats(-1e6, 1e6)
lasts = st.floats(-MAX_SI, MAX_SI)
speeds = st.floats(-6.0, 6.0)
LAW = settings(max_examples=100, deadline=None, derandomize=True)


def bounded(wanted_si, last_si, velocity_si):
    verdicts = bound_assist(wanted_si, last_si, LIMITS, velocity_si, DT_S)
    assert verdicts is not None
    return verdicts


@LAW
@given(wanted=wishes, last=lasts, velocity=speeds)
def test_assist_stays_inside_its_limit_and_rate(wanted, last, velocity):
    sent = bounded(wanted, last, velocity)

    assert abs(sent) <= MAX_SI + NEAR
    assert abs(sent - last) <= STEP_SI + NEAR


@LAW
@given(wanted=wishes, last=lasts, velocity=speeds)
def test_assist_has_no_sign_that_was_not_asked_for(wanted, last, velocity):
    sent = bounded(wanted, last, velocity)

    assert min(wanted, last, 0.0) - NEAR <= sent <= max(wanted, last, 0.0) + NEAR
    if wanted * last >= 0:
        assert sent * (wanted + last) >= 0


@LAW
@given(wanted=wishes, last=lasts, velocity=speeds)
def test_power_takes_away_along_the_motion_and_nothing_else(wanted, last, velocity):
    sent, at_rest = bounded(wanted, last, velocity), bounded(wanted, last, 0.0)

    if sent != at_rest:
        assert abs(velocity) * MAX_SI > POWER_W
        assert (at_rest - sent) * velocity > 0
    if sent * velocity > POWER_W + NEAR:
        # Still on its way down, at the full rate.
        assert abs(last) - abs(sent) == pytest.approx(STEP_SI)


@LAW
@given(one=wishes, other=wishes, last=lasts, velocity=speeds)
def test_assist_follows_what_is_wanted_up_and_down_and_without_a_jump(one, other, last, velocity):
    low, high = sorted((one, other))

    rise = bounded(high, last, velocity) - bounded(low, last, velocity)

    assert -NEAR <= rise <= high - low + NEAR


@LAW
@given(wanted=wishes, last=lasts, velocity=speeds)
def test_what_is_bounded_is_bounded_already(wanted, last, velocity):
    sent = bounded(wanted, last, velocity)

    assert bounded(sent, last, velocity) == pytest.approx(sent, abs=NEAR)


@LAW
@given(
    script=st.lists(st.tuples(st.floats(-50, 50), st.floats(-0.1, 0.1)), min_size=1, max_size=80)
)
def test_a_moving_leg_never_gets_more_power_than_allowed(script):
    """A speed that changes by no more than 10 rad/s^2: the rate is faster than that."""
    sent, velocity = 0.0, 0.0
    for wanted, change in script:
        velocity = min(max(velocity + change, -4.0), 4.0)
        sent = bounded(wanted, sent, velocity)
        assert sent * velocity <= POWER_W + STEP_SI * abs(change)


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("place", [0, 1, 3])
def test_assist_from_a_number_that_is_none_is_none(bad, place):
    arguments = [1.0, 1.0, LIMITS, 0.5, DT_S]
    arguments[place] = bad

    assert bound_assist(*arguments) is None


@pytest.mark.parametrize(
    ("wanted", "velocity", "sent"),
    [
        (MAX_SI, 0.0, MAX_SI),
        (MAX_SI + 1, 0.0, MAX_SI),
        (-MAX_SI - 1, 0.0, -MAX_SI),
        (MAX_SI, POWER_W / MAX_SI, MAX_SI),
        (MAX_SI, 2 * POWER_W / MAX_SI, MAX_SI / 2),
        (-MAX_SI, -2 * POWER_W / MAX_SI, -MAX_SI / 2),
        (-MAX_SI, 2 * POWER_W / MAX_SI, -MAX_SI),
        (MAX_SI, -2 * POWER_W / MAX_SI, MAX_SI),
    ],
)
def test_where_assist_ends_up_after_a_while(wanted, velocity, sent):
    reached = 0.0
    for _ in range(round(MAX_SI / STEP_SI) + 2):
        reached = bounded(wanted, reached, velocity)

    assert reached == pytest.approx(sent)


efforts = st.floats(-1e6, 1e6)
RATE_STEP = LIMITS.effort_rate_max_si_per_s * DT_S


@LAW
@given(one=efforts, other=efforts, last=st.floats(-LIMITS.effort_max_si, LIMITS.effort_max_si))
def test_the_whole_effort_keeps_limit_and_rate_and_follows_without_a_jump(one, other, last):
    low, high = (bound(wish, last, LIMITS, DT_S) for wish in sorted((one, other)))

    assert low is not None
    assert high is not None
    for sent in (low, high):
        assert abs(sent) <= LIMITS.effort_max_si
        assert abs(sent - last) <= RATE_STEP + NEAR
        assert bound(sent, last, LIMITS, DT_S) == sent
    assert -NEAR <= high - low <= abs(one - other) + NEAR


@pytest.mark.parametrize("bad", BAD)
def test_an_effort_that_is_no_number_is_none_from_either_side(bad):
    assert bound(bad, 0.0, LIMITS, DT_S) is None
    assert bound(0.0, bad, LIMITS, DT_S) is None
