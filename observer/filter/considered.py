"""What is not known of the machine, in the published sigma: considered parameters (Schmidt).

The filter takes its physics as true. An error of a mass, a spring or a friction level is no noise:
the estimate of the patient takes it up, and innovations do not show it. So each parameter that is
not sure has a variant of the physics, in which it is one standard deviation larger. The derivative
of the estimate by the parameter (sensitivity.py) is the error e that it makes at the present pose
and motion. The published covariance is that of the filter plus the products of these errors of
friction and patient; net is patient less friction. Errors of different parameters are independent.
An error lasts as long as its parameter: it does not average out over a stride (`strides.py`).

A passive baseline (`observer/baseline.py`) says how far each parameter is off on this machine with
this patient, in its standard deviations, and what is left of its uncertainty. Then these errors are
taken off what is published, and sigma holds what is left:

    error of patient, friction, net: sum of theta_k e_k           theta, P: of the baseline
    covariance                       e' P e + kept + turning      kept: of what only repeats

The derivatives are of first order. At a reversal this filter, and one with the other parameter, let
friction turn at times that differ by about a cycle. So the variance of friction, and of net, holds
`turning`: the mean over TURNING_S of the square of what a cycle changes of friction's known error.

Schmidt, Application of state-space methods to navigation problems, 1966: a consider covariance.
Nothing but what is published reads either: gate, innovations, validity and stops use the filter's
own.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.filter.states import STATE_COUNT
from observer.jit import inline
from observer.mechanism.friction import FrictionParameters
from observer.mechanism.parameters import LegParameters
from observer.quantities import Number

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

VARIANTS_MAX: Final = 32
"""Room for considered parameters."""
N: Final = STATE_COUNT
COVARIANCE: Final = 2 * N
"""Place of the lower triangle, row by row, behind mean and standard deviations."""
FRICTION_ROW: Final = 4
"""Friction of both axes, then the patient, are the rows that parameters make uncertain."""
PATIENT_ROW: Final = FRICTION_ROW + 2
TURNING_S: Final = 0.03
"""Time constant, about that of friction; chosen."""


class Drives(NamedTuple):
    """What the drives and encoders show, as one variant has it: hip and slide."""

    effort_ratio_hip: Number = 1.0
    effort_ratio_slide: Number = 1.0
    """True effort over the one shown: the torque constant."""
    effort_offset_hip_nm: Number = 0.0
    effort_offset_slide_n: Number = 0.0
    position_offset_hip_rad: Number = 0.0
    position_offset_slide_m: Number = 0.0


class Slopes(NamedTuple):
    """What one variant adds to the slopes of friction over position."""

    hip_per_rad: Number = 0.0
    slide_per_m: Number = 0.0


class Variant(NamedTuple):
    """The physics with one parameter a standard deviation larger."""

    leg: LegParameters
    hip: FrictionParameters
    slide: FrictionParameters
    drives: Drives = Drives()
    slopes: Slopes = Slopes()


class Known(NamedTuple):
    """What a passive baseline has found of the considered parameters, as a kernel reads it."""

    taken: bool
    """False: there is no baseline; the rest is 0."""
    theta: Vector
    """Error of each parameter in its standard deviations, (VARIANTS_MAX)."""
    root: Matrix
    """Lower root of the covariance of these errors, (VARIANTS_MAX, VARIANTS_MAX)."""
    kept_std: Vector
    """Standard deviation of what the baseline cannot tell from the patient: N m, N."""


def known_of(theta: Vector, covariance: Matrix, kept_std: Vector) -> Known:
    """What a baseline has found, with room for VARIANTS_MAX parameters.

    Args:
        theta: error of each considered parameter in its standard deviations, (n).
        covariance: of these errors, (n, n), positive definite.
        kept_std: N m, N: what the baseline cannot tell from the patient.
    """
    count = len(theta)
    root: Matrix = np.zeros((VARIANTS_MAX, VARIANTS_MAX))
    root[:count, :count] = np.linalg.cholesky(covariance)
    return Known(True, np.pad(theta, (0, VARIANTS_MAX - count)), root, np.array(kept_std))


NOTHING_KNOWN: Final = Known(
    False, np.zeros(VARIANTS_MAX), np.zeros((VARIANTS_MAX, VARIANTS_MAX)), np.zeros(2)
)


LEG_COUNT: Final = len(LegParameters._fields)
FRICTION_COUNT: Final = len(FrictionParameters._fields)
SLIDE_FRICTION: Final = LEG_COUNT + FRICTION_COUNT
DRIVES: Final = LEG_COUNT + 2 * FRICTION_COUNT
DRIVES_COUNT: Final = len(Drives._fields)
SLOPES: Final = DRIVES + DRIVES_COUNT
OTHER_FRICTION: Final = SLOPES + len(Slopes._fields)
"""1 where the variant has another friction."""
OTHER_LEG: Final = OTHER_FRICTION + 1
"""1 where it has another leg, or another pose."""
VARIANT_SIZE: Final = OTHER_LEG + 1


def table_of(own: Variant, variants: Sequence[Variant]) -> Matrix:
    """The variants as a kernel reads them, shape (VARIANTS_MAX, VARIANT_SIZE).

    Args:
        own: the physics of the filter. What a variant has in common with it is marked, because its
            error is nothing: that need not be computed in each cycle.
        variants: of the considered parameters.

    Raises:
        ValueError: more than VARIANTS_MAX.
    """
    if len(variants) > VARIANTS_MAX:
        raise ValueError(f"{len(variants)} variants of a leg: there is room for {VARIANTS_MAX}")
    table = np.zeros((VARIANTS_MAX, VARIANT_SIZE))
    for row, one in zip(table, variants, strict=False):
        other_friction = (one.hip, one.slide) != (own.hip, own.slide) or any(one.slopes)
        moved = one.drives.position_offset_hip_rad, one.drives.position_offset_slide_m
        other_leg = one.leg != own.leg or moved != (0.0, 0.0)
        others = float(other_friction), float(other_leg)
        row[:] = (*one.leg, *one.hip, *one.slide, *one.drives, *one.slopes, *others)
    return table


@inline
def widen(
    count: int,
    known: Known,
    sensitivity: Matrix,
    net_std_at: int,
    work: Vector,
    patient_errors: Vector,
    passive: Vector,
    out: Vector,
) -> None:
    """Add the errors of all considered parameters to a published covariance.

    Args:
        count: number of parameters.
        known: of the baseline in force.
        sensitivity: derivative of the estimate by each parameter, a row for each, of which friction
            and patient are read (sensitivity.py).
        net_std_at: place of the standard deviation of net in `out`.
        work: scratch, (4 VARIANTS_MAX).
        patient_errors: result, (2 VARIANTS_MAX): of the patient's effort by each parameter, hip
            then slide; with a baseline by each independent combination of them.
        passive: result with a baseline, (4): what is to be taken off friction and patient, hip
            before slide; unchanged without.
        out: mean (8), standard deviations (8) and lower triangle (36) first; changed.
    """
    for k in range(count):
        for i in range(4):
            work[4 * k + i] = sensitivity[k, FRICTION_ROW + i]
    if known.taken:
        _apply(known, count, work, passive)
        for axis in range(2):
            kept = known.kept_std[axis]
            add_variance(PATIENT_ROW + axis, kept * kept, net_std_at, out)
    net_variance_hip = net_variance_slide = 0.0
    for k in range(count):
        friction_hip, friction_slide = work[4 * k], work[4 * k + 1]
        patient_hip, patient_slide = work[4 * k + 2], work[4 * k + 3]
        patient_errors[2 * k], patient_errors[2 * k + 1] = patient_hip, patient_slide
        _add(out, friction_hip, friction_slide, patient_hip, patient_slide)
        net_variance_hip += (patient_hip - friction_hip) ** 2
        net_variance_slide += (patient_slide - friction_slide) ** 2
    at = COVARIANCE + FRICTION_ROW * (FRICTION_ROW + 1) // 2
    for i in range(FRICTION_ROW, N):
        at += i
        out[N + i] = math.sqrt(max(out[at], 0.0))
        at += 1
    out[net_std_at] = math.sqrt(out[net_std_at] ** 2 + net_variance_hip)
    out[net_std_at + 1] = math.sqrt(out[net_std_at + 1] ** 2 + net_variance_slide)


@inline
def _apply(known: Known, count: int, errors: Vector, passive: Vector) -> None:
    """Sum up the known errors, and replace all errors by independent ones of what is left.

    The root is a lower triangle: each new error needs none that is replaced already.
    """
    for i in range(4):
        total = 0.0
        for k in range(count):
            total += known.theta[k] * errors[4 * k + i]
        passive[i] = total
    for j in range(count):
        for i in range(4):
            total = 0.0
            for k in range(j, count):
                total += known.root[k, j] * errors[4 * k + i]
            errors[4 * j + i] = total


@inline
def add_variance(state: int, variance: float, net_std_at: int, out: Vector) -> None:
    """Add a variance to that of a state and of net.

    Args:
        state: friction or patient of an axis.
        variance: of the state, independent of all else.
        net_std_at: place of the standard deviation of net in `out`.
        out: as of `widen`; changed.
    """
    at = COVARIANCE + state * (state + 1) // 2 + state
    out[at] += variance
    out[N + state] = math.sqrt(max(out[at], 0.0))
    net = net_std_at + (state - FRICTION_ROW) % 2
    out[net] = math.sqrt(out[net] ** 2 + variance)


@inline
def follow_turning(passive: Vector, dt_s: float, known_friction: Vector, turning: Vector) -> None:
    """Follow how much the known error of friction changes from cycle to cycle.

    Args:
        passive: from `widen`.
        dt_s: step of this cycle.
        known_friction: known error of friction in the last cycle, (2); NaN if there was none;
            changed.
        turning: mean square of its changes, (2); changed.
    """
    share = 1.0 - math.exp(-dt_s / TURNING_S)
    for axis in range(2):
        change = passive[axis] - known_friction[axis]
        known_friction[axis] = passive[axis]
        if math.isfinite(change):
            turning[axis] += share * (change * change - turning[axis])


@inline
def take_off(passive: Vector, net_at: int, out: Vector) -> None:
    """Take off what the baseline explains of friction and patient, and so of net."""
    for i in range(4):
        out[FRICTION_ROW + i] -= passive[i]
    for axis in range(2):
        out[net_at + axis] -= passive[2 + axis] - passive[axis]


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
