"""Laws (11) to (13): numbers of the reference, symmetry, passivity, memory, and stability."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.mechanism.friction import (
    FrictionParameters,
    bristle_friction,
    bristle_slopes,
    bristles_after,
    friction_after,
    friction_rate,
    gate_of,
    runge_kutta_growth,
    smallest_stribeck,
    stability_number,
    static_friction_of,
    static_slope,
    steady_friction,
)
from tests.observer.trainer import HIP, HIP_BRISTLES, SLIDE_BRISTLES, SLIDE_FRICTION

AXES = pytest.mark.parametrize("f", [HIP, SLIDE_FRICTION], ids=["hip", "slide"])
SPEEDS = st.floats(-1e6, 1e6)


@pytest.mark.parametrize(
    ("speed", "friction"),
    [(0.005, 2.9342801447), (0.05, 7.0), (0.2, 6.1621250492), (-1.0, -6.8)],
)
def test_golden_vectors_of_the_hip(speed, friction):
    assert static_friction_of(HIP, speed) == pytest.approx(friction, abs=1e-10)


@AXES
def test_the_static_law_meets_its_peak_at_the_peak_speed(f):
    assert static_friction_of(f, f.peak) == pytest.approx(f.stribeck, rel=1e-14)


def test_the_true_maximum_is_a_little_above_and_beyond_the_peak():
    speeds = np.linspace(0.04, 0.07, 30_001)
    values = [static_friction_of(HIP, v) for v in speeds]

    assert max(values) == pytest.approx(7.0005, abs=1e-4)
    assert speeds[int(np.argmax(values))] == pytest.approx(0.0512, abs=2e-4)


@AXES
@given(speed=SPEEDS)
@settings(derandomize=True, deadline=None)
def test_the_static_law_is_odd_and_never_drives(f, speed):
    friction = static_friction_of(f, speed)

    assert friction == -static_friction_of(f, -speed)
    assert friction * speed >= 0.0
    assert math.isfinite(friction)


@AXES
def test_at_rest_there_is_no_static_friction_and_the_gate_is_shut(f):
    assert static_friction_of(f, 0.0) == 0.0
    assert gate_of(f, 0.0) == 0.0
    assert math.copysign(1.0, gate_of(f, 0.0)) == 1.0


@AXES
@pytest.mark.parametrize("speed", [1e6, -1e6, 1e-300, -1e-300])
def test_extreme_speeds_neither_overflow_nor_vanish_wrongly(f, speed):
    assert math.isfinite(static_friction_of(f, speed))
    assert static_friction_of(f, speed) != 0.0
    assert 0.0 <= gate_of(f, speed) <= 1.0


@AXES
@given(speed=SPEEDS)
@settings(derandomize=True, deadline=None)
def test_the_gate_is_even_grows_from_zero_and_ends_at_one(f, speed):
    assert 0.0 <= gate_of(f, speed) <= 1.0
    assert gate_of(f, -speed) == gate_of(f, speed)
    assert gate_of(f, 10.0 * f.edge) == 1.0
    assert gate_of(f, f.edge) == pytest.approx(1.0 - math.exp(-1.0))


@AXES
@given(friction=st.floats(-100.0, 100.0), dt_s=st.floats(1e-6, 1.0))
@settings(derandomize=True, deadline=None)
def test_at_rest_friction_remembers_its_value_exactly(f, friction, dt_s):
    assert friction_after(f, friction, 0.0, dt_s) == friction
    assert friction_rate(f, friction, 0.0) == 0.0


@AXES
@pytest.mark.parametrize("speed", [-0.5, -0.02, 0.03, 0.2, 1.5])
def test_in_steady_motion_friction_becomes_the_static_law(f, speed):
    friction = 0.0
    for _ in range(2000):
        friction = friction_after(f, friction, speed, 0.001)

    assert friction == pytest.approx(static_friction_of(f, speed), rel=1e-9)


@AXES
def test_one_time_constant_into_fast_motion_two_thirds_are_there(f):
    reached = friction_after(f, 0.0, 1.0, f.time_constant_s) / static_friction_of(f, 1.0)

    assert reached == pytest.approx(1.0 - math.exp(-1.0), rel=1e-12)


@AXES
@given(
    friction=st.floats(-1.0, 1.0), speeds=st.lists(st.floats(-0.5, 0.5), min_size=1, max_size=30)
)
@settings(derandomize=True, deadline=None)
def test_friction_never_exceeds_the_static_laws_largest_value(f, friction, speeds):
    largest = max(abs(static_friction_of(f, v)) for v in np.linspace(0.0, 0.5, 2001)) * (1 + 1e-6)
    state = friction * largest
    for speed in speeds:
        state = friction_after(f, state, speed, 0.01)
        assert abs(state) <= largest


@AXES
def test_the_rate_is_the_derivative_of_the_exact_step(f):
    for speed in (0.002, 0.02, 0.3):
        ahead, behind = (friction_after(f, 1.0, speed, dt_s) for dt_s in (2e-6, 1e-6))
        assert (ahead - behind) / 1e-6 == pytest.approx(friction_rate(f, 1.0, speed), rel=1e-3)


@AXES
def test_the_slope_is_the_static_laws_derivative(f):
    for speed in np.linspace(-0.3, 0.3, 41):
        step = 1e-7
        difference = static_friction_of(f, speed + step) - static_friction_of(f, speed - step)
        assert static_slope(f, speed) == pytest.approx(difference / (2 * step), abs=1e-3)


def test_a_peak_below_the_rest_of_the_law_is_told_from_one_above():
    assert smallest_stribeck(HIP) == pytest.approx(6.0 * math.tanh(5.0) + 0.8 * 0.05)
    assert HIP.stribeck > smallest_stribeck(HIP)


def steep(f, time_constant_s, edge_per_transition, divisor):
    transition = f.transition / divisor
    return f._replace(
        time_constant_s=time_constant_s,
        edge=edge_per_transition * transition,
        transition=transition,
    )


@pytest.mark.parametrize(
    ("time_constant_s", "edges", "divisor", "hip", "slide"),
    [
        (0.02, 3.0, 1, 0.79, 0.81),
        (0.02, 1.0, 1, 1.3, 2.1),
        (0.005, 3.0, 1, 1.7, 1.8),
        (0.002, 3.0, 5, 6.1, 11.8),
    ],
)
def test_stability_numbers_are_those_of_the_reference(time_constant_s, edges, divisor, hip, slide):
    axes = ((HIP, 1.0, hip), (SLIDE_FRICTION, 13.0, slide))
    for f, inertia, expected in axes:
        number = stability_number(steep(f, time_constant_s, edges, divisor), inertia, 0.01)
        assert number == pytest.approx(expected, rel=0.05)


def growth_of_axis(f, inertia, speed, dt_s, steps=400):
    """One axis held at a speed by a constant effort; how a small disturbance of it has grown."""
    held = static_friction_of(f, speed)
    velocity, friction = speed * (1.0 + 1e-7), held
    for _ in range(steps):
        velocity += dt_s * (held - friction) / inertia
        friction = friction_after(f, friction, velocity, dt_s)
    return abs(velocity - speed) / (abs(speed) * 1e-7)


@AXES
@pytest.mark.parametrize("dt_s", [0.01, 0.005, 0.002])
def test_the_criterion_tells_stable_steps_from_unstable_ones(f, dt_s):
    """Below 4 the linearised axis does not run away; far above it does."""
    inertia = 1.0 if f is HIP else 13.0
    for f_steep in (f, steep(f, 0.002, 3.0, 5)):
        speed = 0.7 * f_steep.edge
        number = stability_number(f_steep, inertia, dt_s)
        if number < 3.9:
            assert growth_of_axis(f_steep, inertia, speed, dt_s) < 1e3


def test_a_criterion_that_is_broken_shows_in_the_axis():
    f = steep(SLIDE_FRICTION, 0.002, 3.0, 5)
    speeds = np.linspace(0.2, 1.5, 40) * f.edge

    assert stability_number(f, 13.0, 0.01) > 4.0
    assert max(growth_of_axis(f, 13.0, speed, 0.01) for speed in speeds) > 1e3


def test_runge_kutta_is_unstable_for_steep_friction_in_one_step_and_stable_in_two():
    f = steep(HIP, 0.002, 3.0, 5)

    assert runge_kutta_growth(f, 1.0, 0.01) > 1.0
    assert runge_kutta_growth(f, 1.0, 0.005) <= 1.0 + 1e-9
    assert runge_kutta_growth(HIP, 1.0, 0.01) <= 1.0 + 1e-9


@pytest.mark.parametrize("speed", [-0.3, -0.004, 0.001, 0.08])
@pytest.mark.parametrize(
    ("f", "bristles"), [(HIP, HIP_BRISTLES), (SLIDE_FRICTION, SLIDE_BRISTLES)], ids=["hip", "slide"]
)
def test_bristles_end_at_the_steady_friction(f, bristles, speed):
    with_them = f._replace(bristle_stiffness=bristles.stiffness, bristle_damping=bristles.damping)
    elastic = bristles_after(with_them, 0.0, speed, 100.0)

    ended = bristle_friction(with_them, elastic, speed, 0.01)

    assert steady_friction(with_them, speed) == pytest.approx(ended, rel=1e-9)
    assert steady_friction(f, speed) == static_friction_of(f, speed)


def test_parameters_are_named_tuples_of_floats_as_kernels_want_them():
    assert all(isinstance(value, float) for value in (*HIP, *SLIDE_FRICTION))
    assert FrictionParameters._fields[-1] == "bristle_damping"


@pytest.mark.parametrize("velocity", [0.01, -0.01])
@pytest.mark.parametrize("elastic", [4.0, -4.0])
def test_slopes_of_bristles_are_their_derivatives(velocity, elastic):
    f = HIP._replace(bristle_stiffness=2000.0, bristle_damping=20.0)
    step = 1e-5

    def slope(by_elastic, by_velocity):
        here = elastic + by_elastic * step, velocity + by_velocity * step
        there = elastic - by_elastic * step, velocity - by_velocity * step
        return (bristle_friction(f, *here, 0.01) - bristle_friction(f, *there, 0.01)) / (2 * step)

    assert bristle_slopes(f, elastic, velocity, 0.01) == pytest.approx(
        (slope(1, 0), slope(0, 1)), rel=1e-6
    )
