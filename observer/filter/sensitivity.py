"""How the estimate answers to an error of the machine's file: its derivative by each parameter.

The filter's patient takes up an error of a mass, a spring or a friction level within some samples.
It takes it up sooner where innovations have raised the patient's noise, and overshoots where the
patient's rate is carried on. At rest friction takes it up. An error of friction turns with each
reversal, and the others change with pose and motion. So the derivative s = dx / dp of the filter's
mean goes through each cycle with the mean:

    prediction    s := A (s - b) + b          A: differences of the sigma points
                  b = F'_s(v) - F_s(v)        in the rows of friction and patient
                    + M' a + h' - M a - h - (u' - u)   in those of the patient: net
    correction    s := s - K (s_hip, s_slide)                K: gain of this cycle, 0 without one
    rate          as the patient's rate goes (patient_rate.py)
    at rest       friction at its breakaway level has that of the law with the other parameter

With friction less by b in its row and the patient less by b in his, the leg moves the same and
friction follows the filter's own law. a is the acceleration of the estimate, h the bias of eq. (6)
with springs, u' the effort of the drives as the other parameter has it. Bristles have the share
F / g of b's level: they yield at the rate |v| sigma_0 / g. p is in its standard deviations
(`considered.py`). The smoother takes the derivatives back with the mean (`smoother.py`).

Left out is what is of second order or acts for a cycle: how gain, rate and its switches depend on
the parameter, the curvature between sigma points, and `viscous_outside`. Near the singularity of
the leg b is large, and s needs some tenths of a second to fall behind it.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.filter.cdkf import STEP
from observer.filter.considered import (
    DRIVES,
    DRIVES_COUNT,
    FRICTION_COUNT,
    FRICTION_ROW,
    LEG_COUNT,
    OTHER_FRICTION,
    OTHER_LEG,
    PATIENT_ROW,
    SLIDE_FRICTION,
    SLOPES,
    Drives,
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
from observer.mechanism.linkage import accelerations, dynamics, efforts
from observer.mechanism.parameters import LegParameters

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

FADED: Final = 1e-100
"""A derivative below it is 0, in the units of its state."""
RATE: Final = N
"""Place of both patient rates behind the mean."""


class _Motion(NamedTuple):
    """Pose, velocity, acceleration (SI) and the efforts that they need, of hip and slide."""

    position: tuple[float, float]
    velocity: tuple[float, float]
    acceleration: tuple[float, float]
    needed: tuple[float, float]


@kernel
def follow_parameters(
    model: LegModel,
    over: tuple[OverPosition, OverPosition],
    variants: Matrix,
    count: int,
    m: LegMemory,
    mean: Vector,
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
        mean: as reported, first eight of an array; friction of bristles has its damping.
        points: propagated sigma points of this cycle.
        dt_s: its time step.
    """
    effort = m.acting[0], m.acting[1]
    motion = _motion(model, effort, mean)
    transition = m.work[N:]
    _find_transition(m, points, transition)
    for k in range(count):
        row, s = variants[k], m.sensitivity[k]
        hip, slide = model.hip, model.slide
        friction_hip = friction_slide = 0.0
        if row[OTHER_FRICTION] > 0.0:
            hip = FrictionParameters(*fixed_tuple(row[LEG_COUNT:], FRICTION_COUNT))
            hip_over = OverPosition(over[0].slope + row[SLOPES], over[0].middle)
            hip = at_position(hip, hip_over, m.backup_mean[0])
            slide = FrictionParameters(*fixed_tuple(row[SLIDE_FRICTION:], FRICTION_COUNT))
            slide_over = OverPosition(over[1].slope + row[SLOPES + 1], over[1].middle)
            slide = at_position(slide, slide_over, m.backup_mean[1])
            friction_hip = _friction_error(model.hip, hip, m, 0)
            friction_slide = _friction_error(model.slide, slide, m, 1)
        net_hip, net_slide = _net_errors(row, motion, model.coriolis_share, effort)
        patient_hip, patient_slide = friction_hip + net_hip, friction_slide + net_slide
        _shift(s, -friction_hip, -friction_slide, -patient_hip, -patient_slide)
        _predict(m, transition, dt_s, s)
        _shift(s, friction_hip, friction_slide, patient_hip, patient_slide)
        for i in range(N):
            m.forecast_sensitivity[k, i] = s[i]
        _correct(m, s)
        _hold(model.hip, hip, m, 0, s)
        _hold(model.slide, slide, m, 1, s)
        _keep_finite(s, m.forecast_sensitivity[k])


@inline
def _motion(model: LegModel, effort: tuple[float, float], mean: Vector) -> _Motion:
    q1, q2, v1, v2 = mean[0], mean[1], mean[2], mean[3]
    own = dynamics(model.leg, q1, q2, v1, v2, model.coriolis_share)
    needed_hip = effort[0] + mean[PATIENT_ROW] - mean[FRICTION_ROW]
    needed_slide = effort[1] + mean[PATIENT_ROW + 1] - mean[FRICTION_ROW + 1]
    a1, a2 = accelerations(own, needed_hip, needed_slide)
    return _Motion((q1, q2), (v1, v2), (a1, a2), efforts(own, a1, a2))


@inline
def _net_errors(
    row: Vector, motion: _Motion, coriolis_share: float, effort: tuple[float, float]
) -> tuple[float, float]:
    """What the other leg and the other drives need more than the filter's: N m, N."""
    shown = Drives(*fixed_tuple(row[DRIVES:], DRIVES_COUNT))
    hip = (1.0 - shown.effort_ratio_hip) * effort[0] - shown.effort_offset_hip_nm
    slide = (1.0 - shown.effort_ratio_slide) * effort[1] - shown.effort_offset_slide_n
    if row[OTHER_LEG] > 0.0:
        leg = LegParameters(*fixed_tuple(row, LEG_COUNT))
        at_hip = motion.position[0] + shown.position_offset_hip_rad
        at_slide = motion.position[1] + shown.position_offset_slide_m
        other = dynamics(leg, at_hip, at_slide, *motion.velocity, coriolis_share)
        other_hip, other_slide = efforts(other, *motion.acceleration)
        hip += other_hip - motion.needed[0]
        slide += other_slide - motion.needed[1]
    return hip, slide


@inline
def _friction_error(
    own: FrictionParameters, other: FrictionParameters, m: LegMemory, axis: int
) -> float:
    """What the other law adds to where friction goes: of bristles with their present share."""
    velocity = m.mean[2 + axis]
    if own.bristle_stiffness > 0.0:
        level = bristle_level(own, velocity)
        share = m.mean[FRICTION_ROW + axis] / level
        more = bristle_level(other, velocity) - level
        return share * more + (other.viscous - own.viscous) * velocity
    return static_friction(other, velocity) - static_friction(own, velocity)


@inline
def _shift(
    s: Vector,
    friction_hip: float,
    friction_slide: float,
    patient_hip: float,
    patient_slide: float,
) -> None:
    s[FRICTION_ROW] += friction_hip
    s[FRICTION_ROW + 1] += friction_slide
    s[PATIENT_ROW] += patient_hip
    s[PATIENT_ROW + 1] += patient_slide


@inline
def _find_transition(m: LegMemory, points: Vector, transition: Vector) -> None:
    """Write A, row by row: differences of the points over their reach, times S^-1."""
    reach = 0.5 / STEP
    for i in range(N):
        base, row = i * LANES + 1, i * N
        for k in range(N - 1, -1, -1):
            total = reach * (points[base + k] - points[base + N + k])
            for j in range(k + 1, N):
                total -= transition[row + j] * m.backup_root[j, k]
            own = m.backup_root[k, k]
            transition[row + k] = total / own if own > 0.0 else 0.0


@inline
def _predict(m: LegMemory, transition: Vector, dt_s: float, s: Vector) -> None:
    """Carry one derivative through the prediction."""
    for axis in range(2):
        if m.carried_rate[axis] == 0.0:
            s[RATE + axis] = 0.0
        s[PATIENT_ROW + axis] += 0.5 * dt_s * s[RATE + axis]
    for i in range(N):
        total = 0.0
        for k in range(N):
            total += transition[i * N + k] * s[k]
        m.work[i] = total
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
    """Begin anew after a number that is not finite; let what has faded be 0.

    What a parameter does to the other axis fades without end, and a processor takes a hundred times
    as long for numbers below 1e-308.
    """
    total = 0.0
    for i in range(RATE + 2):
        if abs(s[i]) < FADED:
            s[i] = 0.0
        total += s[i]
    if not math.isfinite(total):
        for i in range(RATE + 2):
            s[i] = 0.0
        for i in range(N):
            forecast[i] = 0.0
