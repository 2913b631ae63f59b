"""Parts of the mechanism for filters and plants: pose, link rates, dynamics, acceleration.

`mechanism.py` has the derivation and the functions for callers in Python. Its kernels and the loop
over sigma points use the functions of this file: scalars in, scalars out, no branches, never NaN.

Symbols: K thigh (hip to knee), u shank (knee to ankle), w shoe (slide joint to ankle); q1, v1 hip
angle and velocity, q2, v2 slide position and velocity.
"""

import math
from typing import NamedTuple

from observer.jit import inline
from observer.mechanism.elementary import cos_sin
from observer.mechanism.parameters import GRAVITY, LegParameters
from observer.quantities import Area, Effort, Inertia, Length, Mass, TurnRate


class Pose(NamedTuple):
    """Link vectors: thigh K, shank u, shoe w; m."""

    knee_x: Length
    knee_y: Length
    shank_x: Length
    shank_y: Length
    shoe_x: Length
    shoe_y: Length
    delta: Area
    """cross(u, w) = -(shank)(shoe) sin(angle between them), m^2; 0 is the only singularity."""
    closes: bool


class Rates(NamedTuple):
    """Angular rate of shank and shoe per driven rate: rad/rad and rad/m."""

    shank_hip: TurnRate
    shank_slide: TurnRate
    shoe_hip: TurnRate
    shoe_slide: TurnRate


class Dynamics(NamedTuple):
    """M q'' + bias = u + d - F: the matrix, and all terms that depend on q and q' only."""

    m11: Inertia
    m12: Inertia
    m22: Inertia
    bias_hip: Effort
    bias_slide: Effort
    closes: bool


@inline
def pose(p: LegParameters, hip: float, slide: float) -> Pose:
    """Links at q; if the circles do not meet, shank and shoe are held at the smallest ratio."""
    cosine, sine = cos_sin(p.thigh_angle_rad + hip)
    knee_x = p.thigh_length_m * cosine
    knee_y = p.thigh_length_m * sine
    # D = S - K; the ankle is at K + (alpha - i eta) D, alpha = half / |D|^2, eta = delta / |D|^2
    dx = p.rail_x_m + slide * p.rail_cos - knee_x
    dy = p.rail_y_m + slide * p.rail_sin - knee_y
    d2 = dx * dx + dy * dy
    shank2 = p.shank_length_m * p.shank_length_m
    half = 0.5 * (shank2 - p.shoe_length_m * p.shoe_length_m + d2)
    delta2 = shank2 * d2 - half * half
    smallest2 = p.smallest_delta * p.smallest_delta
    delta = math.sqrt(max(delta2, smallest2))
    over_d2 = 1.0 / max(d2, smallest2)
    alpha = half * over_d2
    eta = delta * over_d2
    shank_x = alpha * dx + eta * dy
    shank_y = alpha * dy - eta * dx
    return Pose(
        knee_x, knee_y, shank_x, shank_y, shank_x - dx, shank_y - dy, -delta, delta2 > smallest2
    )


@inline
def rates(p: LegParameters, at: Pose) -> Rates:
    """W in the module docstring: from u' = i omega u and K' + u' = S' + w', dotted with w and u."""
    over_delta = 1.0 / at.delta
    return Rates(
        shank_hip=(at.knee_y * at.shoe_x - at.knee_x * at.shoe_y) * over_delta,
        shank_slide=(p.rail_cos * at.shoe_x + p.rail_sin * at.shoe_y) * over_delta,
        shoe_hip=(at.knee_y * at.shank_x - at.knee_x * at.shank_y) * over_delta,
        shoe_slide=(p.rail_cos * at.shank_x + p.rail_sin * at.shank_y) * over_delta,
    )


@inline
def dynamics(
    p: LegParameters, q1: float, q2: float, v1: float, v2: float, coriolis_share: float
) -> Dynamics:
    """M(q), and c(q, q') + C~(q, q') q' + g(q) as `bias`; eq. (6).

    Args:
        p: the leg.
        q1: hip angle, rad.
        q2: slide position, m.
        v1: hip velocity, rad/s.
        v2: slide velocity, m/s.
        coriolis_share: 1 for the full dynamics, 0 for the paper's, which leaves out c.
    """
    at = pose(p, q1, q2)
    w = rates(p, at)
    b = _coupling(p, at)
    # M = W' B W
    p2 = b.b12 + p.shank_inertia * w.shank_hip + b.b23 * w.shoe_hip
    p3 = b.b13 + p.shoe_inertia * w.shoe_hip + b.b23 * w.shank_hip
    s2 = p.shank_inertia * w.shank_slide + b.b23 * w.shoe_slide
    s3 = p.shoe_inertia * w.shoe_slide + b.b23 * w.shank_slide
    m11 = p.thigh_inertia + b.b12 * w.shank_hip + b.b13 * w.shoe_hip
    m11 += w.shank_hip * p2 + w.shoe_hip * p3
    m12 = w.shank_slide * p2 + w.shoe_slide * p3
    m22 = p.slide_inertia + w.shank_slide * s2 + w.shoe_slide * s3
    rate2 = w.shank_hip * v1 + w.shank_slide * v2
    rate3 = w.shoe_hip * v1 + w.shoe_slide * v2
    # Rates of a pose that does not exist are not physical: no Coriolis terms there.
    share = coriolis_share if at.closes else 0.0
    square1 = share * v1 * v1
    square2 = share * rate2 * rate2
    square3 = share * rate3 * rate3
    alpha2, alpha3 = _bias_accelerations(p, at, square1, square2, square3)
    # Generalised forces of the three links: B alpha + h + G + dampers.
    knee = p.knee_damping * (rate2 - v1)
    ankle = p.ankle_damping * (rate3 - rate2)
    force1 = b.b12 * alpha2 + b.b13 * alpha3 - square2 * b.e12 - square3 * b.e13
    force1 += GRAVITY * (p.thigh_moment_re * at.knee_x - p.thigh_moment_im * at.knee_y)
    force1 += p.hip_damping * v1 - knee
    force2 = p.shank_inertia * alpha2 + b.b23 * alpha3 + square1 * b.e12 - square3 * b.e23
    force2 += GRAVITY * b.x2 + knee - ankle
    force3 = b.b23 * alpha2 + p.shoe_inertia * alpha3 + square1 * b.e13 + square2 * b.e23
    force3 += ankle + p.slide_joint_damping * rate3 - GRAVITY * b.x3
    bias1 = force1 + w.shank_hip * force2 + w.shoe_hip * force3
    bias2 = p.slide_weight_n + w.shank_slide * force2 + w.shoe_slide * force3
    bias1 += p.hip_stiffness * (q1 - p.hip_rest_rad)
    bias2 += p.slide_stiffness * (q2 - p.slide_rest_m)
    return Dynamics(m11, m12, m22, bias1, bias2, at.closes)


@inline
def accelerations(d: Dynamics, effort1: float, effort2: float) -> tuple[float, float]:
    """Acceleration of hip and slide under generalised forces (N m, N)."""
    rest1, rest2 = effort1 - d.bias_hip, effort2 - d.bias_slide
    determinant = d.m11 * d.m22 - d.m12 * d.m12
    return (d.m22 * rest1 - d.m12 * rest2) / determinant, (
        d.m11 * rest2 - d.m12 * rest1
    ) / determinant


@inline
def efforts(d: Dynamics, a1: float, a2: float) -> tuple[float, float]:
    """Generalised forces (N m, N) that an acceleration of hip and slide needs."""
    return d.m11 * a1 + d.m12 * a2 + d.bias_hip, d.m12 * a1 + d.m22 * a2 + d.bias_slide


class _Coupling(NamedTuple):
    """B and h of the module docstring, without the links' own inertias."""

    x2: Mass
    """Horizontal part of the shank's moment, rotated into the shank's direction."""
    x3: Mass
    """The same for the shoe."""
    b12: Inertia
    b13: Inertia
    b23: Inertia
    """Couple the links' angular accelerations: dot products."""
    e12: Inertia
    e13: Inertia
    e23: Inertia
    """Couple the squares of their rates: cross products."""


@inline
def _coupling(p: LegParameters, at: Pose) -> _Coupling:
    x2 = p.shank_moment_re * at.shank_x - p.shank_moment_im * at.shank_y
    y2 = p.shank_moment_re * at.shank_y + p.shank_moment_im * at.shank_x
    x3 = p.shoe_moment_re * at.shoe_x - p.shoe_moment_im * at.shoe_y
    y3 = p.shoe_moment_re * at.shoe_y + p.shoe_moment_im * at.shoe_x
    return _Coupling(
        x2=x2,
        x3=x3,
        b12=at.knee_x * x2 + at.knee_y * y2,
        b13=-(at.knee_x * x3 + at.knee_y * y3),
        b23=-(at.shank_x * x3 + at.shank_y * y3),
        e12=at.knee_x * y2 - at.knee_y * x2,
        e13=at.knee_y * x3 - at.knee_x * y3,
        e23=at.shank_y * x3 - at.shank_x * y3,
    )


@inline
def _bias_accelerations(
    p: LegParameters, at: Pose, square1: float, square2: float, square3: float
) -> tuple[float, float]:
    """Angular acceleration of shank and shoe at q'' = 0, from the squares of the links' rates.

    The closure condition K + u = S + w, differentiated twice and dotted with w and with u.
    """
    knee_shoe = at.knee_x * at.shoe_x + at.knee_y * at.shoe_y
    knee_shank = at.knee_x * at.shank_x + at.knee_y * at.shank_y
    shank_shoe = at.shank_x * at.shoe_x + at.shank_y * at.shoe_y
    shank2 = p.shank_length_m * p.shank_length_m
    shoe2 = p.shoe_length_m * p.shoe_length_m
    over_delta = 1.0 / at.delta
    alpha2 = (square1 * knee_shoe + square2 * shank_shoe - square3 * shoe2) * over_delta
    alpha3 = (square1 * knee_shank + square2 * shank2 - square3 * shank_shoe) * over_delta
    return alpha2, alpha3


@inline
def bounded_acceleration(
    p: LegParameters,
    q1: float,
    q2: float,
    v1: float,
    v2: float,
    force1: float,
    force2: float,
    coriolis_share: float,
) -> tuple[float, float, bool]:
    """Return the acceleration under generalised forces (N m, N), and True if a pose exists at q.

    Never NaN. Where it does not close, shank and shoe act as if held at the smallest ratio: a
    stiff strut.
    """
    d = dynamics(p, q1, q2, v1, v2, coriolis_share)
    over_determinant = 1.0 / (d.m11 * d.m22 - d.m12 * d.m12)
    net1 = force1 - d.bias_hip
    net2 = force2 - d.bias_slide
    a1 = (d.m22 * net1 - d.m12 * net2) * over_determinant
    a2 = (d.m11 * net2 - d.m12 * net1) * over_determinant
    return a1, a2, d.closes
