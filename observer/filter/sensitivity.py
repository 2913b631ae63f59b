"""How the estimate answers to an error of friction: its derivative by each parameter.

An error of a friction level turns with each reversal. The filter's patient takes it up within some
samples. It takes it up sooner where innovations have raised the patient's noise, and overshoots
where the patient's rate is carried on. So the derivative s = dx / dp of the filter's mean goes
through each cycle with the mean:

    prediction    s := A (s - b) + b          A: differences of the sigma points
                  b = F'_s(v) - F_s(v) in the rows of friction and patient
    correction    s := s - K (s_hip, s_slide)                K: gain of this cycle, 0 without one
    rate          as the patient's rate goes (patient_rate.py)
    at rest       friction at its breakaway level has that of the law with the other parameter

With friction and patient both less by b, the leg moves the same and friction follows the filter's
own law. Bristles have the share F / g of b's level: they yield at the rate |v| sigma_0 / g. p is in
its standard deviations (`considered.py`). A parameter that leaves friction as it is has no
derivative here: its error changes slowly. The smoother takes the derivatives back with the mean
(`smoother.py`).

Left out is what is of second order or acts for a cycle: how gain, rate and its switches depend on
the parameter, the curvature between sigma points, and `viscous_outside`.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.filter.cdkf import STEP
from observer.filter.considered import (
    FRICTION_COUNT,
    FRICTION_ROW,
    LEG_COUNT,
    OTHER_FRICTION,
    PATIENT_ROW,
    SLIDE_FRICTION,
    SLOPES,
)
from observer.filter.leg_memory import LegMemory, N
from observer.filter.leg_model import LANES, LegModel
from observer.filter.patient_rate import fading
from observer.jit import fixed_tuple, inline, kernel
from observer.mechanism.friction import (
    FrictionParameters,
    OverPosition,
    at_position,
    bristle_level,
    static_friction,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

RATE: Final = N
"""Place of both patient rates behind the mean."""


@kernel
def follow_friction(
    model: LegModel,
    over: tuple[OverPosition, OverPosition],
    variants: Matrix,
    count: int,
    m: LegMemory,
    points: Vector,
    dt_s: float,
) -> None:
    """Advance `sensitivity` of a memory by the cycle that it has just finished.

    Args:
        model: the physics of the filter at this pose.
        over: how friction rises along both axes.
        variants: as of `considered.table_of`.
        count: their number.
        m: after the correction, or its rejection.
        points: propagated sigma points of this cycle.
        dt_s: its time step.
    """
    for k in range(count):
        row, s = variants[k], m.sensitivity[k]
        if row[OTHER_FRICTION] == 0.0:
            continue
        hip = FrictionParameters(*fixed_tuple(row[LEG_COUNT:], FRICTION_COUNT))
        hip_over = OverPosition(over[0].slope + row[SLOPES], over[0].middle)
        hip = at_position(hip, hip_over, m.backup_mean[0])
        slide = FrictionParameters(*fixed_tuple(row[SLIDE_FRICTION:], FRICTION_COUNT))
        slide_over = OverPosition(over[1].slope + row[SLOPES + 1], over[1].middle)
        slide = at_position(slide, slide_over, m.backup_mean[1])
        wrong_hip = _wrong(model.hip, hip, m, 0)
        wrong_slide = _wrong(model.slide, slide, m, 1)
        _shift(s, -wrong_hip, -wrong_slide)
        _predict(m, points, dt_s, s)
        _shift(s, wrong_hip, wrong_slide)
        for i in range(N):
            m.forecast_sensitivity[k, i] = s[i]
        _correct(m, s)
        _hold(model.hip, hip, m, 0, s)
        _hold(model.slide, slide, m, 1, s)
        _keep_finite(s, m.forecast_sensitivity[k])


@inline
def _wrong(own: FrictionParameters, other: FrictionParameters, m: LegMemory, axis: int) -> float:
    """What the other law adds to where friction goes: of bristles with their present share."""
    velocity = m.mean[2 + axis]
    if own.bristle_stiffness > 0.0:
        level = bristle_level(own, velocity)
        share = m.mean[FRICTION_ROW + axis] / level
        more = bristle_level(other, velocity) - level
        return share * more + (other.viscous - own.viscous) * velocity
    return static_friction(other, velocity) - static_friction(own, velocity)


@inline
def _shift(s: Vector, hip: float, slide: float) -> None:
    s[FRICTION_ROW] += hip
    s[FRICTION_ROW + 1] += slide
    s[PATIENT_ROW] += hip
    s[PATIENT_ROW + 1] += slide


@inline
def _predict(m: LegMemory, points: Vector, dt_s: float, s: Vector) -> None:
    """Carry one derivative through the prediction: the points' differences over their reach."""
    for axis in range(2):
        if m.carried_rate[axis] == 0.0:
            s[RATE + axis] = 0.0
        s[PATIENT_ROW + axis] += 0.5 * dt_s * s[RATE + axis]
    for i in range(N):
        for k in range(i):
            s[i] -= m.backup_root[i, k] * s[k]
        s[i] = s[i] / m.backup_root[i, i] if m.backup_root[i, i] > 0.0 else 0.0
    reach = 0.5 / STEP
    for i in range(N):
        base = i * LANES + 1
        total = 0.0
        for k in range(N):
            total += (points[base + k] - points[base + N + k]) * s[k]
        m.work[i] = reach * total
    for i in range(N):
        s[i] = m.work[i]
    for axis in range(2):
        s[PATIENT_ROW + axis] += 0.5 * dt_s * s[RATE + axis]
        s[RATE + axis] *= fading(dt_s)


@inline
def _correct(m: LegMemory, s: Vector) -> None:
    """Carry one derivative through the correction, and the rates with it."""
    hip, slide = s[0], s[1]
    for i in range(N):
        s[i] -= m.gain[i, 0] * hip + m.gain[i, 1] * slide
    for axis in range(2):
        of_patient = m.gain[PATIENT_ROW + axis, 0] * hip + m.gain[PATIENT_ROW + axis, 1] * slide
        s[RATE + axis] = m.rate_kept[axis] * s[RATE + axis] - m.rate_gain[axis] * of_patient
        if m.patient_rate[axis] == 0.0:
            s[RATE + axis] = 0.0


@inline
def _hold(
    own: FrictionParameters, other: FrictionParameters, m: LegMemory, axis: int, s: Vector
) -> None:
    """Let friction that was bounded at rest have the bound of the other law."""
    friction = m.mean[FRICTION_ROW + axis]
    if abs(friction) == own.stribeck:
        held = (other.stribeck - own.stribeck) * friction / own.stribeck
        s[PATIENT_ROW + axis] += held - s[FRICTION_ROW + axis]
        s[FRICTION_ROW + axis] = held


@inline
def _keep_finite(s: Vector, forecast: Vector) -> None:
    """Begin anew after numbers that no law of an axis gives."""
    total = 0.0
    for i in range(RATE + 2):
        total += s[i]
    if not math.isfinite(total):
        for i in range(RATE + 2):
            s[i] = 0.0
        for i in range(N):
            forecast[i] = 0.0
