"""Innovations of a filter without a patient, from which the likelihood of parameters is computed.

An extended Kalman filter of six states (positions, velocities, friction of both axes) over the same
mechanism and friction law as the observer's, in substeps that are symmetric and of second order:

    friction by half a substep, exactly, at the old velocity                (11)
    half a substep of position, the whole one of velocity, half of position (6)
    friction by half a substep at the new velocity

The derivatives of a step come from seven points, the mean and one beside it for each state, in
eight lanes that are vector code. An effort noise represents what neither mechanism nor friction
explains. While an axis rests, friction is a random walk, because the law is hardly smooth there and
no real joint obeys it. The two axes of a row are processed one after the other, so their
innovations are independent.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.filter.leg_model import LegModel, model_at
from observer.jit import inline, kernel
from observer.mechanism.friction import (
    FrictionParameters,
    OverPosition,
    bristle_friction,
    bristles_after,
    friction_after,
)
from observer.mechanism.linkage import bounded_acceleration, dynamics

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

STATES: Final = 6
LANES: Final = 8


@kernel
def _advance(
    model: LegModel,
    effort: Vector,
    step_s: float,
    rests: NDArray[np.bool_],
    points: Vector,
    rates: Vector,
) -> None:
    """Advance all lanes by one substep in place; `rates` keeps accelerations between substeps."""
    half_s = 0.5 * step_s
    half1_s = 0.0 if rests[0] else half_s
    half2_s = 0.0 if rests[1] else half_s
    # Not LANES: the compiler unrolls a loop of known count, and then does not vectorise it.
    for j in range(points.size // STATES):
        v1 = points[2 * LANES + j]
        v2 = points[3 * LANES + j]
        f1 = _state_after(model.hip, points[4 * LANES + j], v1, half1_s)
        f2 = _state_after(model.slide, points[5 * LANES + j], v2, half2_s)
        q1 = points[j] + half_s * v1
        q2 = points[LANES + j] + half_s * v2
        w1 = v1 + half_s * rates[j]
        w2 = v2 + half_s * rates[LANES + j]
        a1, a2, _ = bounded_acceleration(
            model.leg,
            q1,
            q2,
            w1,
            w2,
            effort[0] - _acting(model.hip, f1, w1, half1_s),
            effort[1] - _acting(model.slide, f2, w2, half2_s),
            model.coriolis_share,
        )
        v1 += step_s * a1
        v2 += step_s * a2
        rates[j] = a1
        rates[LANES + j] = a2
        points[j] = q1 + half_s * v1
        points[LANES + j] = q2 + half_s * v2
        points[2 * LANES + j] = v1
        points[3 * LANES + j] = v2
        points[4 * LANES + j] = _state_after(model.hip, f1, v1, half1_s)
        points[5 * LANES + j] = _state_after(model.slide, f2, v2, half2_s)


@inline
def _state_after(f: FrictionParameters, state: float, velocity: float, dt_s: float) -> float:
    """Friction state after a part of a substep; of no length for an axis that rests."""
    if f.bristle_stiffness > 0.0:
        return bristles_after(f, state, velocity, dt_s)
    return friction_after(f, state, velocity, dt_s)


@inline
def _acting(f: FrictionParameters, state: float, velocity: float, dt_s: float) -> float:
    """Friction that acts; of an axis that rests the state alone."""
    if f.bristle_stiffness > 0.0 and dt_s > 0.0:
        return bristle_friction(f, state, velocity, dt_s)
    return state


@kernel
def _begin(
    model: LegModel,
    noise: Vector,
    start: Vector,
    effort: Vector,
    spread: Vector,
    mean: Vector,
    cov: Matrix,
) -> None:
    """Start at a smoothed position, velocity and acceleration: friction is the residual effort."""
    d = dynamics(model.leg, start[0], start[1], start[2], start[3], model.coriolis_share)
    for i in range(4):
        mean[i] = start[i]
    mean[4] = effort[0] - d.m11 * start[4] - d.m12 * start[5] - d.bias_hip
    mean[5] = effort[1] - d.m12 * start[4] - d.m22 * start[5] - d.bias_slide
    cov[:] = 0.0
    for i in range(STATES):
        std = noise[i] if i < 2 else spread[i - 2]
        cov[i, i] = std * std


@kernel
def _predict(
    mean: Vector,
    cov: Matrix,
    noise: Vector,
    friction1: float,
    friction2: float,
    points: Vector,
    width: Vector,
    work: Matrix,
) -> None:
    """Compute mean and covariance after the step from the lanes' ends."""
    jacobian = work[:STATES]
    product = work[STATES:]
    for i in range(STATES):
        for j in range(STATES):
            jacobian[i, j] = (points[i * LANES + 1 + j] - points[i * LANES]) / width[j]
        mean[i] = points[i * LANES]
    for i in range(STATES):
        for j in range(STATES):
            total = 0.0
            for k in range(STATES):
                total += jacobian[i, k] * cov[k, j]
            product[i, j] = total
    for i in range(STATES):
        for j in range(i + 1):
            total = 0.0
            for k in range(STATES):
                total += product[i, k] * jacobian[j, k]
            # An effort moves an axis like a friction of the same size and opposite sign.
            if i < 4:
                total += noise[2] * noise[2] * jacobian[i, 4] * jacobian[j, 4]
                total += noise[3] * noise[3] * jacobian[i, 5] * jacobian[j, 5]
            cov[i, j] = total
            cov[j, i] = total
    cov[4, 4] += friction1 * friction1
    cov[5, 5] += friction2 * friction2


@kernel
def _correct(mean: Vector, cov: Matrix, axis: int, surprise: float, variance: float) -> None:
    """Correct by one measured position; the covariance stays symmetric."""
    for i in range(STATES):
        mean[i] += cov[i, axis] / variance * surprise
    column = cov[:, axis].copy()
    for i in range(STATES):
        for j in range(STATES):
            cov[i, j] -= column[i] * column[j] / variance


@kernel
def _step(
    model: LegModel,
    effort: Vector,
    step_s: float,
    substeps: int,
    rests: NDArray[np.bool_],
    mean: Vector,
    width: Vector,
    points: Vector,
    rates: Vector,
) -> None:
    """Advance all lanes, the mean and its neighbours, to the end of a row."""
    for i in range(STATES):
        for j in range(LANES):
            points[i * LANES + j] = mean[i]
        points[i * LANES + 1 + i] += width[i]
    rates[:] = 0.0
    for _ in range(substeps):
        _advance(model, effort, step_s / substeps, rests, points, rates)


class KalmanTuning(NamedTuple):
    """Standard deviations and steps of the filter."""

    noise: Vector
    """Both positions, efforts and frictions, shape (6,)."""
    rest_noise: Vector
    """A friction while its axis rests, where the law does not act, shape (2,)."""
    spread: Vector
    """Velocities and frictions where the filter begins, shape (4,)."""
    width: Vector
    """Distance from the mean at which derivatives are taken, shape (6,)."""
    substeps: int
    over: tuple[OverPosition, OverPosition]
    """How friction rises along hip and slide: that of a row is the one where it begins."""


class KalmanRows(NamedTuple):
    """Inputs of n rows."""

    steps_s: Vector
    position: Matrix
    """Shape (n, 2); NaN where it was not measured."""
    effort: Matrix
    """Shape (n, 2); acted from the row before."""
    begins: NDArray[np.bool_]
    rests: NDArray[np.bool_]
    """Shape (n, 2)."""
    starts: Matrix
    """Shape (n, 6): position, velocity, acceleration, where the filter begins."""


@kernel
def innovations(
    model: LegModel, tuning: KalmanTuning, rows: KalmanRows, surprise: Matrix, variance: Matrix
) -> None:
    """Write innovations of all rows and their variances to `surprise` and `variance`, shape (n, 2).

    Both are NaN where nothing was measured, and where the filter begins.
    """
    noise, rest_noise, spread, width, substeps, over = tuning
    steps_s, position, effort, begins, rests, starts = rows
    mean, cov = np.zeros(STATES), np.zeros((STATES, STATES))
    work = np.zeros((2 * STATES, STATES))
    points, rates = np.zeros(STATES * LANES), np.zeros(2 * LANES)
    for row in range(steps_s.size):
        surprise[row, 0] = surprise[row, 1] = np.nan
        variance[row, 0] = variance[row, 1] = np.nan
        if begins[row]:
            _begin(model, noise, starts[row], effort[row], spread, mean, cov)
            continue
        step_s, row_effort = steps_s[row], effort[row]
        here = model_at(model, over[0], over[1], mean[0], mean[1])
        _step(here, row_effort, step_s, substeps, rests[row], mean, width, points, rates)
        friction1 = rest_noise[0] if rests[row, 0] else noise[4]
        friction2 = rest_noise[1] if rests[row, 1] else noise[5]
        _predict(mean, cov, noise, friction1, friction2, points, width, work)
        for axis in range(2):
            if not np.isnan(position[row, axis]):
                surprise[row, axis] = position[row, axis] - mean[axis]
                variance[row, axis] = cov[axis, axis] + noise[axis] * noise[axis]
                _correct(mean, cov, axis, surprise[row, axis], variance[row, axis])
