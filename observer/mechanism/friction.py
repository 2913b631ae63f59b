"""Friction of one axis: the static law (13), the gate (12), the dynamic state (11), their limits.

    F_s(v) = (F^ - Fc tanh(v_p / v_t) - d v_p) (v / v_p) exp((1 - (v / v_p)^2) / 2)
             + Fc tanh(v / v_t) + d v                                                       (13)
    a(v)   = 1 - exp(-(v / v_0)^2)                                                          (12)
    F'     = a(v) / T1 (F_s(v) - F)                                                         (11)

The static law is odd, dissipative (F_s v >= 0) and equals F^ exactly at the peak speed v_p. The
gate holds the friction state at rest, where it keeps the load; in motion the state follows the law.

Its level may rise along the axis, as where a seal or a rail is not straight: Coulomb's level and
the hump times 1 + slope (q - middle), which stays between the bounds of LEVEL_RATIOS. Viscous
friction stays, so that a law is one at each level.

An axis may have bristles instead of (11); (12) then only decides what counts as standstill. Canudas
de Wit, Olsson, Astrom, Lischinsky, "A new model for control of systems with friction", IEEE Trans.
Autom. Control 40 (1995), eq. (2) to (4), with the elastic part F = sigma_0 z as the state:

    F' = sigma_0 (v - |v| F / g(v)),    friction = F + sigma_1 / sigma_0 F' + d v

The level g is the static law (13) without its viscous part, at no less than the peak speed: the
rise of (13) from zero stands for what the bristles do. They yield elastically up to breakaway, and
after a reversal the friction changes its sign over a distance, not over a time.

Units: hip N m, rad/s; slide N, m/s; the same law for both.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.jit import inline, kernel
from observer.mechanism.elementary import expm1_of_negative, tanh
from observer.quantities import Effort, Number, Position, Speed, Stiffness, Viscosity

Vector = NDArray[np.float64]

SQRT_E: Final = math.exp(0.5)
SUBSTEPS_MAX: Final = 10
STANDSTILL_GATE: Final = 0.5
"""a(v) below this counts as standstill: friction and patient are not distinguishable."""


class FrictionParameters(NamedTuple):
    """Friction parameters of one axis, eqs. (11) to (13)."""

    stribeck: Effort
    """F^, the peak of the static law."""
    coulomb: Effort
    """Fc."""
    viscous: Viscosity
    """d."""
    transition: Speed
    """v_t, where tanh saturates."""
    peak: Speed
    """v_p, where the static law equals F^."""
    edge: Speed
    """v_0 of the gate."""
    time_constant_s: float
    """T1."""
    bristle_stiffness: Stiffness = 0.0
    """sigma_0; 0 for eq. (11)."""
    bristle_damping: Viscosity = 0.0
    """sigma_1."""


LEVEL_RATIOS: Final = (0.5, 1.5)
"""Least and greatest level along an axis: an integrator that is stable with both is so between."""


class OverPosition(NamedTuple):
    """How the level of an axis's friction rises along it."""

    slope: Number
    """1/rad or 1/m; 0: the same everywhere."""
    middle: Position
    """Where the levels are those of FrictionParameters."""


EVERYWHERE: Final = OverPosition(0.0, 0.0)
"""Friction that is the same at each position."""


@inline
def at_position(f: FrictionParameters, over: OverPosition, position: float) -> FrictionParameters:
    """The friction of an axis at a position."""
    ratio = 1.0 + over.slope * (position - over.middle)
    return at_level(f, min(max(ratio, LEVEL_RATIOS[0]), LEVEL_RATIOS[1]))


@inline
def at_level(f: FrictionParameters, ratio: float) -> FrictionParameters:
    """The friction of an axis with Coulomb's level and the hump times a ratio."""
    return FrictionParameters(
        ratio * f.stribeck + (1.0 - ratio) * f.viscous * f.peak,
        ratio * f.coulomb,
        f.viscous,
        f.transition,
        f.peak,
        f.edge,
        f.time_constant_s,
        f.bristle_stiffness,
        f.bristle_damping,
    )


def levels_of(f: FrictionParameters, over: OverPosition) -> tuple[FrictionParameters, ...]:
    """The extremes that the friction of an axis can have along it."""
    return (f,) if over.slope == 0.0 else tuple(at_level(f, ratio) for ratio in LEVEL_RATIOS)


@inline
def static_friction(f: FrictionParameters, velocity: float) -> float:
    """F_s(v), eq. (13)."""
    at_peak = velocity / f.peak
    bell = SQRT_E * (1.0 + expm1_of_negative(-0.5 * at_peak * at_peak))
    hump = f.stribeck - f.coulomb * tanh(f.peak / f.transition) - f.viscous * f.peak
    return hump * at_peak * bell + f.coulomb * tanh(velocity / f.transition) + f.viscous * velocity


@inline
def gate(f: FrictionParameters, velocity: float) -> float:
    """a(v) in 0..1, eq. (12)."""
    at_edge = velocity / f.edge
    return 0.0 - expm1_of_negative(-at_edge * at_edge)  # 0.0 - 0.0 avoids -0.0 at rest


@inline
def friction_rate(f: FrictionParameters, friction: float, velocity: float) -> float:
    """F', eq. (11): N m/s or N/s."""
    return gate(f, velocity) / f.time_constant_s * (static_friction(f, velocity) - friction)


@inline
def followed(f: FrictionParameters, velocity: float, dt_s: float) -> float:
    """Share of its way to the law that friction goes in `dt_s`, by the exact solution of (11)."""
    return -expm1_of_negative(-gate(f, velocity) * dt_s / f.time_constant_s)


@inline
def friction_after(f: FrictionParameters, friction: float, velocity: float, dt_s: float) -> float:
    """F after `dt_s` at constant velocity: the exact solution of eq. (11)."""
    return friction + followed(f, velocity, dt_s) * (static_friction(f, velocity) - friction)


@inline
def bristle_level(f: FrictionParameters, velocity: float) -> float:
    """g(v): the elastic part's limit in steady motion."""
    speed = max(math.fabs(velocity), f.peak)
    return static_friction(f, speed) - f.viscous * speed


@inline
def bristles_after(f: FrictionParameters, elastic: float, velocity: float, dt_s: float) -> float:
    """Elastic part after `dt_s` at constant velocity: the exact solution."""
    level = bristle_level(f, velocity)
    share = bristles_followed(f, velocity, dt_s)
    return elastic + share * (math.copysign(level, velocity) - elastic)


@inline
def bristles_followed(f: FrictionParameters, velocity: float, dt_s: float) -> float:
    """Share of its way to the level that the elastic part goes in `dt_s`."""
    stiffness = f.bristle_stiffness * math.fabs(velocity) / bristle_level(f, velocity)
    return -expm1_of_negative(-stiffness * dt_s)


@inline
def bristle_friction(f: FrictionParameters, elastic: float, velocity: float, dt_s: float) -> float:
    """Friction with `elastic` at the start of a step of constant velocity.

    The damping is its mean over the step, which stays passive where the bristles follow faster.
    """
    change = bristles_after(f, elastic, velocity, dt_s) - elastic
    return elastic + f.bristle_damping / f.bristle_stiffness * change / dt_s + f.viscous * velocity


@inline
def bristle_slopes(
    f: FrictionParameters, elastic: float, velocity: float, dt_s: float
) -> tuple[float, float]:
    """Derivatives of `bristle_friction` by the elastic part and by the velocity; g is held."""
    level = bristle_level(f, velocity)
    left = 1.0 + expm1_of_negative(-f.bristle_stiffness * math.fabs(velocity) / level * dt_s)
    damping = f.bristle_damping
    by_elastic = 1.0 - damping / f.bristle_stiffness * (1.0 - left) / dt_s
    return by_elastic, damping * left * (
        1.0 - math.copysign(1.0, velocity) * elastic / level
    ) + f.viscous


@kernel
def static_friction_of(f: FrictionParameters, velocity: float) -> float:
    """F_s(v), eq. (13), for callers in Python."""
    return static_friction(f, velocity)


@inline
def law_variance(f: FrictionParameters, std: Number, velocity: float) -> float:
    """Variance of the law at a velocity, whose part of (13) that is curved is uncertain by `std`.

    A law that is fitted to an axis is wrong by a smooth function of the velocity, most at reversals
    and hardly where friction is viscous. That error is not noise: it stays the same for many
    cycles, so the filter cannot learn it from innovations, and it is only reported.
    """
    scaled = velocity / (f.transition + f.peak)
    return (std / (1.0 + scaled * scaled)) ** 2


@kernel
def gate_of(f: FrictionParameters, velocity: float) -> float:
    """a(v), eq. (12), for callers in Python."""
    return gate(f, velocity)


def steady_friction(f: FrictionParameters, velocity: float) -> float:
    """Friction in steady motion: (13), for an axis with bristles without its rise from zero."""
    if f.bristle_stiffness == 0.0:
        return static_friction_of(f, velocity)
    return math.copysign(bristle_level(f, velocity), velocity) + f.viscous * velocity


def smallest_stribeck(f: FrictionParameters) -> float:
    """Lower limit of F^: the rest of the law at the peak speed; below it the hump is inverted."""
    return f.coulomb * math.tanh(f.peak / f.transition) + f.viscous * f.peak


def static_slope(f: FrictionParameters, velocity: Vector) -> Vector:
    """dF_s/dv at each velocity: N m s/rad or N s/m."""
    at_peak = velocity / f.peak
    hump = (f.stribeck - smallest_stribeck(f)) / f.peak
    bell = hump * (1.0 - at_peak**2) * np.exp(0.5 * (1.0 - at_peak**2))
    over = np.minimum(np.abs(velocity / f.transition), 350.0)
    return bell + f.coulomb / f.transition / np.cosh(over) ** 2 + f.viscous


def stability_number(f: FrictionParameters, inertia: float, dt_s: float) -> float:
    """Largest e (2 + kappa) over all speeds; semi-implicit steps of `dt_s` are stable below 4.

    Args:
        f: the axis.
        inertia: least effective inertia of the axis, kg m^2 or kg.
        dt_s: one substep.

    kappa = F_s'(v) dt / M, e = 1 - exp(-a(v) dt / T1), from the Jury criterion of the axis
    linearised at v. Where the slope is negative the axis itself is unstable (stick-slip); there the
    number is small, and the instability is not the integrator's.
    """
    speed = _speeds(f)
    opened = -np.expm1(-((speed / f.edge) ** 2))
    share = -np.expm1(-opened * dt_s / f.time_constant_s)
    return float(np.max(share * (2.0 + static_slope(f, speed) * dt_s / inertia)))


def _speeds(f: FrictionParameters) -> Vector:
    """From rest to beyond all that the law distinguishes, the densest near rest."""
    return 4.0 * max(f.transition, f.peak, f.edge) * np.linspace(0.0, 1.0, 2001) ** 2


def bristle_stability_number(f: FrictionParameters, inertia: float, dt_s: float) -> float:
    """Semi-implicit steps of `dt_s` are stable at rest below 4 (Jury criterion).

    Args:
        f: an axis with bristles.
        inertia: least effective inertia of the axis, kg m^2 or kg.
        dt_s: one substep.

    Judged at z = 0. Right after a reversal from full slip bristles act up to twice as stiff, so
    above 2 the acceleration may ring until they have yielded; F stays within the level.
    """
    damping = f.bristle_damping + f.viscous
    return dt_s / inertia * (f.bristle_stiffness * dt_s + 2.0 * damping)


def runge_kutta_growth(f: FrictionParameters, inertia: float, dt_s: float) -> float:
    """Largest growth of a disturbance in one RK4 step of `dt_s`, over all speeds; stable up to 1.

    Only speeds with a rising static law count: elsewhere the axis itself is unstable.
    """
    speed = _speeds(f)[1:]
    slope = static_slope(f, speed)
    speed, slope = speed[slope > 0.0], slope[slope > 0.0]
    # v' = -F / M, F' = r (F_s' v - F): eigenvalues of -r/2 +- sqrt(r^2/4 - r F_s' / M)
    rate = -np.expm1(-((speed / f.edge) ** 2)) / f.time_constant_s
    root = np.sqrt((0.25 * rate * rate - rate * slope / inertia).astype(np.complex128))
    z = (np.stack((root, -root)) - 0.5 * rate) * dt_s
    factor = 1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0)))
    return float(np.max(np.abs(factor)))
