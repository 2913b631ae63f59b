"""The overall model (23): its two maps, when they are stable, and the edge of the workspace."""

import math

import numpy as np
import pytest

from observer.filter.leg_model import (
    LANES,
    Integrator,
    LegModel,
    integrator_named,
    runge_kutta,
    semi_implicit,
    substeps_for,
    substeps_needed,
)
from observer.jit import kernel
from observer.mechanism.mechanism import gravity, smallest_inertia
from tests.observer.trainer import HIP, PATIENT, PROTOTYPE, SLIDE_FRICTION

FULL = LegModel(PATIENT, HIP, SLIDE_FRICTION, 1.0)
PAPER = LegModel(PATIENT, HIP, SLIDE_FRICTION, 0.0)
INTEGRATORS = pytest.mark.parametrize("integrator", list(Integrator), ids=lambda i: i.name.lower())


@kernel
def moved(model, is_rk4, state, effort_hip, effort_slide, dt_s, substeps):
    """One state after `dt_s`, through the loops over sigma points; and how many were outside."""
    points = np.empty(8 * LANES)
    for row in range(8):
        points[row * LANES : (row + 1) * LANES] = state[row]
    outside = 0
    for _ in range(substeps):
        if is_rk4:
            outside += runge_kutta(model, effort_hip, effort_slide, dt_s / substeps, points)
        else:
            outside += semi_implicit(model, effort_hip, effort_slide, dt_s / substeps, points)
    return points.reshape((8, LANES)), outside


def step(model, integrator, state, effort=(5.0, 30.0), dt_s=0.01, substeps=2):
    points, outside = moved(
        model, integrator is Integrator.RK4, np.asarray(state, dtype=float), *effort, dt_s, substeps
    )
    return points, outside


MOVING = (0.2, 0.5, 0.8, -0.4, 5.0, -60.0, 1.0, 10.0)


def test_all_lanes_compute_the_same():
    """Vector code or not: a sigma point's place in memory does not matter."""
    for integrator in Integrator:
        points, _ = step(FULL, integrator, MOVING)
        np.testing.assert_array_equal(points, np.tile(points[:, :1], LANES))


def fine(model, state, effort=(5.0, 30.0), dt_s=0.01):
    return step(model, Integrator.RK4, state, effort, dt_s, 1000)[0][:, 0]


@pytest.mark.parametrize(
    ("integrator", "substeps", "motion", "friction"),
    [
        (Integrator.RK4, 2, 1e-6, 1e-3),
        (Integrator.SEMI_IMPLICIT, 2, 5e-3, 1.0),
        (Integrator.SEMI_IMPLICIT, 10, 1e-3, 0.3),
    ],
)
def test_one_step_is_as_near_to_the_fine_solution_as_its_order_says(
    integrator, substeps, motion, friction
):
    difference = step(FULL, integrator, MOVING, substeps=substeps)[0][:, 0] - fine(FULL, MOVING)

    assert np.abs(difference[:4]).max() <= motion
    assert np.abs(difference[4:6]).max() <= friction
    np.testing.assert_array_equal(difference[6:], 0.0)


@pytest.mark.parametrize(
    ("integrator", "motion", "friction"),
    [(Integrator.RK4, 1e-6, 3e-4), (Integrator.SEMI_IMPLICIT, 0.0, 0.0)],
)
def test_ten_milliseconds_are_twice_five(integrator, motion, friction):
    """Substeps follow the time step, so the two ways take the same ones, or nearly."""
    once, _ = step(FULL, integrator, MOVING, substeps=2)
    half, _ = step(FULL, integrator, MOVING, dt_s=0.005, substeps=1)
    twice, _ = step(FULL, integrator, half[:, 0], dt_s=0.005, substeps=1)

    difference = np.abs(twice[:, 0] - once[:, 0])
    assert difference[:4].max() <= motion
    assert difference[4:].max() <= friction


@kernel
def count_substeps(dt_s, substeps):
    return substeps_for(dt_s, substeps)


@pytest.mark.parametrize(
    ("dt_s", "expected"), [(0.010, 2), (0.0104, 2), (0.005, 1), (0.001, 1), (0.02, 4), (0.1, 20)]
)
def test_substeps_follow_the_time_step_but_not_its_jitter(dt_s, expected):
    assert count_substeps(dt_s, 2) == expected


def test_two_short_steps_of_rk4_are_nearly_one_long():
    once, _ = step(FULL, Integrator.RK4, MOVING, substeps=2)
    half, _ = step(FULL, Integrator.RK4, MOVING, dt_s=0.005, substeps=2)
    twice, _ = step(FULL, Integrator.RK4, half[:, 0], dt_s=0.005, substeps=2)

    difference = np.abs(twice[:, 0] - once[:, 0])
    assert difference[:4].max() <= 1e-6
    assert difference[4:].max() <= 5e-4


def test_without_coriolis_the_model_is_another():
    difference = fine(PAPER, MOVING) - fine(FULL, MOVING)

    assert np.abs(difference[2:4]).max() > 1e-3


@INTEGRATORS
def test_at_rest_in_balance_nothing_moves(integrator):
    """Friction that carries the load holds it: the memory of eq. (11)."""
    state = np.array([0.2, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    state[4:6] = -gravity(PATIENT, state[:2])

    after, _ = step(FULL, integrator, state, effort=(0.0, 0.0), substeps=2)

    np.testing.assert_allclose(after[:, 0], state, atol=1e-12)


def test_the_demo_friction_needs_one_substep_and_steep_friction_more():
    inertia = smallest_inertia(PROTOTYPE, 0.3)
    steep_hip = HIP._replace(time_constant_s=0.002, transition=0.002, edge=0.006)
    steep_slide = SLIDE_FRICTION._replace(time_constant_s=0.002, transition=8e-4, edge=2.4e-3)

    for integrator in Integrator:
        assert substeps_needed(HIP, SLIDE_FRICTION, inertia, integrator) == 1
        assert 2 <= substeps_needed(steep_hip, steep_slide, inertia, integrator) <= 5


@INTEGRATORS
def test_friction_too_steep_for_any_substeps_is_refused(integrator):
    wall = HIP._replace(time_constant_s=1e-5, transition=1e-5, edge=1e-5)

    with pytest.raises(ValueError, match="too steep"):
        substeps_needed(wall, SLIDE_FRICTION, smallest_inertia(PATIENT, 0.3), integrator)


@pytest.mark.parametrize("name", ["euler", "explicit_euler", "Euler"])
def test_explicit_euler_is_refused_with_its_reason(name):
    with pytest.raises(ValueError, match="unstable at 10 ms"):
        integrator_named(name)


def test_an_unknown_integrator_is_refused_with_what_is_allowed():
    with pytest.raises(ValueError, match="semi_implicit, rk4"):
        integrator_named("leapfrog")


@pytest.mark.parametrize("integrator", list(Integrator))
def test_integrators_are_found_by_the_names_of_the_configuration(integrator):
    assert integrator_named(integrator.name.lower()) is integrator


@INTEGRATORS
@pytest.mark.parametrize("pose", [(math.radians(-20.0), 0.9), (0.2, 3.0), (1.5, -2.0), (0.2, -5.0)])
def test_points_outside_of_the_workspace_are_counted_and_stay_finite(integrator, pose):
    points, outside = step(FULL, integrator, (*pose, 1.0, -1.0, 3.0, 40.0, 0.0, 0.0))

    assert outside > 0
    assert np.all(np.isfinite(points))


def test_points_inside_are_not_counted():
    assert step(FULL, Integrator.RK4, MOVING)[1] == 0
