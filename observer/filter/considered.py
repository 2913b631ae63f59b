"""What is not known of the machine, in the published sigma: considered parameters (Schmidt).

The filter takes its physics as true. An error of a mass, a spring or a friction level is no noise:
the estimate of the patient takes it up, and innovations do not show it. So each parameter that is
not sure has a variant of the physics, in which it is one standard deviation larger. At the present
pose and motion the two need other efforts:

    net       M'(q) a + h'(q, v) - M(q) a - h(q, v) - (u' - u)      a = M^-1 (u + net - h)
    friction  F'_s(v) - F_s(v), followed as eq. (11) does           eq. (13)
    patient   net + friction                                        h: bias of eq. (6), with springs

where u' is the effort of the drives as this variant has it. The published covariance is that of the
filter plus the products of these errors; errors of different parameters are independent. The filter
follows within some 60 ms, so an error of the present moment is that of the estimate but near a
reversal. An error lasts as long as its parameter: it does not average out over a stride
(`strides.py`).

Schmidt, Application of state-space methods to navigation problems, 1966: a consider covariance.
Nothing but what is published reads it: gate, innovations, validity and stops use the filter's own.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.filter.leg_model import LegModel
from observer.filter.states import STATE_COUNT
from observer.jit import fixed_tuple, inline
from observer.mechanism.friction import (
    FrictionParameters,
    bristles_followed,
    followed,
    static_friction,
)
from observer.mechanism.linkage import dynamics
from observer.mechanism.parameters import LegParameters
from observer.quantities import Number

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

VARIANTS_MAX: Final = 28
"""Room for considered parameters."""
N: Final = STATE_COUNT
COVARIANCE: Final = 2 * N
"""Place of the lower triangle, row by row, behind mean and standard deviations."""
FRICTION_ROW: Final = 4
"""Friction of both axes, then the patient, are the rows that parameters make uncertain."""


class Drives(NamedTuple):
    """What the drives and encoders show, as one variant has it: hip and slide."""

    effort_ratio_hip: Number = 1.0
    effort_ratio_slide: Number = 1.0
    """True effort over the one shown: the torque constant."""
    effort_offset_hip_nm: Number = 0.0
    effort_offset_slide_n: Number = 0.0
    position_offset_hip_rad: Number = 0.0
    position_offset_slide_m: Number = 0.0


class Variant(NamedTuple):
    """The physics with one parameter a standard deviation larger."""

    leg: LegParameters
    hip: FrictionParameters
    slide: FrictionParameters
    drives: Drives = Drives()


LEG_COUNT: Final = len(LegParameters._fields)
FRICTION_COUNT: Final = len(FrictionParameters._fields)
SLIDE_FRICTION: Final = LEG_COUNT + FRICTION_COUNT
DRIVES: Final = LEG_COUNT + 2 * FRICTION_COUNT
DRIVES_COUNT: Final = len(Drives._fields)
VARIANT_SIZE: Final = DRIVES + DRIVES_COUNT


def table_of(variants: Sequence[Variant]) -> Matrix:
    """The variants as a kernel reads them, shape (VARIANTS_MAX, VARIANT_SIZE).

    Raises:
        ValueError: more than VARIANTS_MAX.
    """
    if len(variants) > VARIANTS_MAX:
        raise ValueError(f"{len(variants)} variants of a leg: there is room for {VARIANTS_MAX}")
    table = np.zeros((VARIANTS_MAX, VARIANT_SIZE))
    for row, one in zip(table, variants, strict=False):
        row[:] = (*one.leg, *one.hip, *one.slide, *one.drives)
    return table


@inline
def follow(
    model: LegModel, variants: Matrix, count: int, v1: float, v2: float, dt_s: float, errors: Vector
) -> None:
    """Advance the error of friction by each considered parameter, (2 VARIANTS_MAX), by a step.

    It lags behind the law as friction does: after a reversal it keeps its sign for a while.
    """
    law_hip, law_slide = static_friction(model.hip, v1), static_friction(model.slide, v2)
    share_hip, share_slide = _share(model.hip, v1, dt_s), _share(model.slide, v2, dt_s)
    for k in range(count):
        row = variants[k]
        hip = FrictionParameters(*fixed_tuple(row[LEG_COUNT:], FRICTION_COUNT))
        slide = FrictionParameters(*fixed_tuple(row[SLIDE_FRICTION:], FRICTION_COUNT))
        errors[2 * k] += share_hip * (static_friction(hip, v1) - law_hip - errors[2 * k])
        errors[2 * k + 1] += share_slide * (
            static_friction(slide, v2) - law_slide - errors[2 * k + 1]
        )


@inline
def _share(f: FrictionParameters, velocity: float, dt_s: float) -> float:
    if f.bristle_stiffness > 0.0:
        return bristles_followed(f, velocity, dt_s)
    return followed(f, velocity, dt_s)


@inline
def widen(
    model: LegModel,
    variants: Matrix,
    count: int,
    effort: tuple[float, float],
    friction_errors: Vector,
    net_std_at: int,
    patient_errors: Vector,
    out: Vector,
) -> None:
    """Add the errors of all considered parameters to a published covariance.

    Args:
        model: the physics of the filter.
        variants: as of `table_of`.
        count: their number.
        effort: of the drives, N m and N.
        friction_errors: of each parameter, as `follow` has left them.
        net_std_at: place of the standard deviation of net in `out`.
        patient_errors: result, (2 VARIANTS_MAX): of the patient's effort by each parameter, hip
            then slide.
        out: mean (8), standard deviations (8) and lower triangle (36) first; changed.
    """
    q1, q2, v1, v2 = out[0], out[1], out[2], out[3]
    share = model.coriolis_share
    own = dynamics(model.leg, q1, q2, v1, v2, share)
    needed_hip = effort[0] + out[6] - out[4]
    needed_slide = effort[1] + out[7] - out[5]
    rest_hip, rest_slide = needed_hip - own.bias_hip, needed_slide - own.bias_slide
    determinant = own.m11 * own.m22 - own.m12 * own.m12
    a1 = (own.m22 * rest_hip - own.m12 * rest_slide) / determinant
    a2 = (own.m11 * rest_slide - own.m12 * rest_hip) / determinant
    own_hip = own.m11 * a1 + own.m12 * a2 + own.bias_hip
    own_slide = own.m12 * a1 + own.m22 * a2 + own.bias_slide
    net_variance_hip = net_variance_slide = 0.0
    for k in range(count):
        row = variants[k]
        leg = LegParameters(*fixed_tuple(row, LEG_COUNT))
        shown = Drives(*fixed_tuple(row[DRIVES:], DRIVES_COUNT))
        at_hip, at_slide = q1 + shown.position_offset_hip_rad, q2 + shown.position_offset_slide_m
        other = dynamics(leg, at_hip, at_slide, v1, v2, share)
        net_hip = other.m11 * a1 + other.m12 * a2 + other.bias_hip - own_hip
        net_slide = other.m12 * a1 + other.m22 * a2 + other.bias_slide - own_slide
        net_hip -= (shown.effort_ratio_hip - 1.0) * effort[0] + shown.effort_offset_hip_nm
        net_slide -= (shown.effort_ratio_slide - 1.0) * effort[1] + shown.effort_offset_slide_n
        friction_hip, friction_slide = friction_errors[2 * k], friction_errors[2 * k + 1]
        patient_hip, patient_slide = net_hip + friction_hip, net_slide + friction_slide
        patient_errors[2 * k], patient_errors[2 * k + 1] = patient_hip, patient_slide
        _add(out, friction_hip, friction_slide, patient_hip, patient_slide)
        net_variance_hip += net_hip * net_hip
        net_variance_slide += net_slide * net_slide
    at = COVARIANCE + FRICTION_ROW * (FRICTION_ROW + 1) // 2
    for i in range(FRICTION_ROW, N):
        at += i
        out[N + i] = math.sqrt(max(out[at], 0.0))
        at += 1
    out[net_std_at] = math.sqrt(out[net_std_at] ** 2 + net_variance_hip)
    out[net_std_at + 1] = math.sqrt(out[net_std_at + 1] ** 2 + net_variance_slide)


@inline
def _add(out: Vector, f1: float, f2: float, d1: float, d2: float) -> None:
    """Add the products of one parameter's errors: friction, then patient, hip before slide."""
    error = (f1, f2, d1, d2)
    at = COVARIANCE + FRICTION_ROW * (FRICTION_ROW + 1) // 2
    for i in range(4):
        at += FRICTION_ROW
        for j in range(i + 1):
            out[at] += error[i] * error[j]
            at += 1
