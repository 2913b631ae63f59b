"""The overall model (23): eight states over one time step, for all sigma points at once.

    phi'  = v            mechanism (6), effort u + d - F        patient  d' = 0 + noise  (16), (17)
    F'    = a(v) / T1 (F_s(v) - F)                              friction (11)

Two maps of one substep:
- semi-implicit: velocities first, positions with their mean, then friction, exactly, for the new
  velocity held; stable where `friction.stability_number` is below 4;
- RK4 of the whole.

An axis with bristles has their elastic part as friction state. They need the semi-implicit map: at
speed they follow within a millisecond, which only the exact solution allows.

Explicit Euler is not usable: at 10 ms it needs F_s'(v) dt / M < 1, and real joints have 3 to 10.

Points lie as in `cdkf.py`. The loops run over all LANES, also those beyond the last point, which
repeat the mean: a loop of a known multiple of eight is vector code without a remainder.
"""

import math
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.filter.states import STATE_COUNT
from observer.jit import inline, kernel
from observer.mechanism.friction import (
    FrictionParameters,
    OverPosition,
    at_position,
    bristle_friction,
    bristle_stability_number,
    bristles_after,
    friction_after,
    friction_rate,
    runge_kutta_growth,
    stability_number,
)
from observer.mechanism.linkage import bounded_acceleration
from observer.mechanism.parameters import LegParameters
from observer.quantities import Effort, Number, Position, Speed

STEP_S: Final = 0.01
"""Time step to which noise and substeps refer."""
LANES: Final = 24
"""17 sigma points, filled up to a multiple of the widest vector registers."""
SUBSTEPS_MAX: Final = 10
STABILITY_LIMIT: Final = 4.0
GROWTH_LIMIT: Final = 1.0 + 1e-9

Vector = NDArray[np.float64]


class Integrator(IntEnum):
    """Integration method of one substep."""

    SEMI_IMPLICIT = 0
    RK4 = 1


def integrator_named(name: str) -> Integrator:
    """Return the integrator of a configuration.

    Raises:
        ValueError: unknown name; explicit Euler is refused with its reason.
    """
    if name.lower() in ("euler", "explicit_euler"):
        raise ValueError(
            f"integrator {name!r} is unstable at {1e3 * STEP_S:.0f} ms with real friction; "
            "allowed: semi_implicit, rk4"
        )
    known = {integrator.name.lower(): integrator for integrator in Integrator}
    if name not in known:
        raise ValueError(f"no integrator {name!r}; allowed: {', '.join(known)}")
    return known[name]


def substeps_needed(
    hip: FrictionParameters,
    slide: FrictionParameters,
    inertia: tuple[float, float],
    integrator: Integrator,
) -> int:
    """Fewest substeps of 10 ms at which the integrator is stable on both axes.

    Args:
        hip: friction of the hip.
        slide: friction of the slide.
        inertia: least effective inertia of the two, `mechanism.smallest_inertia`.
        integrator: the one in use.

    Raises:
        ValueError: SUBSTEPS_MAX are not enough, or the integrator cannot follow bristles.
    """
    if integrator is Integrator.RK4 and hip.bristle_stiffness + slide.bristle_stiffness > 0.0:
        raise ValueError(
            "semi_implicit, because bristles follow within a millisecond, too fast for rk4"
        )
    for substeps in range(1, SUBSTEPS_MAX + 1):
        axes = zip((hip, slide), inertia, strict=True)
        if all(_stable(f, mass, STEP_S / substeps, integrator) for f, mass in axes):
            return substeps
    raise ValueError(
        f"friction is too steep for {SUBSTEPS_MAX} substeps of {integrator.name.lower()}: "
        "raise transition, edge or time_constant_s, or lower a bristle_stiffness"
    )


def _stable(f: FrictionParameters, inertia: float, dt_s: float, integrator: Integrator) -> bool:
    if f.bristle_stiffness > 0.0:
        return bristle_stability_number(f, inertia, dt_s) < STABILITY_LIMIT
    if integrator is Integrator.SEMI_IMPLICIT:
        return stability_number(f, inertia, dt_s) < STABILITY_LIMIT
    return runge_kutta_growth(f, inertia, dt_s) <= GROWTH_LIMIT


@inline
def substeps_for(dt_s: float, substeps: int) -> int:
    """Number of substeps for `dt_s` that keeps them about as long as those of a nominal step."""
    # Jitter of some percent must not change the count.
    return max(1, math.ceil(substeps * dt_s / STEP_S - 0.1))


class LegModel(NamedTuple):
    """All physical parameters of the model."""

    leg: LegParameters
    hip: FrictionParameters
    slide: FrictionParameters
    coriolis_share: Number
    """1 for the full dynamics, 0 for the paper's."""
    viscous_outside: Number = 0.0
    """1: viscous friction acts at once; 0, the paper's: through the low-pass, like all of (13)."""


@inline
def model_at(
    model: LegModel, hip: OverPosition, slide: OverPosition, hip_rad: float, slide_m: float
) -> LegModel:
    """The model with the friction of a pose: it changes little in a step."""
    return LegModel(
        model.leg,
        at_position(model.hip, hip, hip_rad),
        at_position(model.slide, slide, slide_m),
        model.coriolis_share,
        model.viscous_outside,
    )


@kernel
def semi_implicit(
    model: LegModel, effort_hip: float, effort_slide: float, dt_s: float, points: Vector
) -> int:
    """Advance one substep in place; return the number of points where no pose exists."""
    outside = 0
    at_once_hip = model.viscous_outside * _viscous_in_state(model.hip)
    at_once_slide = model.viscous_outside * _viscous_in_state(model.slide)
    # Not LANES: the compiler unrolls a loop of known count, and then does not vectorise it.
    for j in range(points.size // STATE_COUNT):
        velocity_hip = points[2 * LANES + j]
        velocity_slide = points[3 * LANES + j]
        friction_hip = points[4 * LANES + j]
        friction_slide = points[5 * LANES + j]
        acting_hip = _acting(model.hip, friction_hip, velocity_hip, dt_s)
        acting_slide = _acting(model.slide, friction_slide, velocity_slide, dt_s)
        a_hip, a_slide, inside = bounded_acceleration(
            model.leg,
            points[j],
            points[LANES + j],
            velocity_hip,
            velocity_slide,
            effort_hip + points[6 * LANES + j] - acting_hip,
            effort_slide + points[7 * LANES + j] - acting_slide,
            model.coriolis_share,
        )
        # Positions by the mean velocity: the new one would add an error of dt^2 a / 2.
        points[j] += dt_s * (velocity_hip + 0.5 * dt_s * a_hip)
        points[LANES + j] += dt_s * (velocity_slide + 0.5 * dt_s * a_slide)
        velocity_hip += dt_s * a_hip
        velocity_slide += dt_s * a_slide
        points[2 * LANES + j] = velocity_hip
        points[3 * LANES + j] = velocity_slide
        friction_hip += at_once_hip * dt_s * a_hip
        friction_slide += at_once_slide * dt_s * a_slide
        points[4 * LANES + j] = _state_after(model.hip, friction_hip, velocity_hip, dt_s)
        points[5 * LANES + j] = _state_after(model.slide, friction_slide, velocity_slide, dt_s)
        outside += 0 if inside else 1
    return outside


@inline
def _acting(f: FrictionParameters, state: float, velocity: float, dt_s: float) -> float:
    """Friction that acts during a substep, from the state at its start."""
    if f.bristle_stiffness > 0.0:
        return bristle_friction(f, state, velocity, dt_s)
    return state


@inline
def _state_after(f: FrictionParameters, state: float, velocity: float, dt_s: float) -> float:
    """Friction state after a substep."""
    if f.bristle_stiffness > 0.0:
        return bristles_after(f, state, velocity, dt_s)
    return friction_after(f, state, velocity, dt_s)


@inline
def _viscous_in_state(f: FrictionParameters) -> float:
    """Viscous friction within the friction state: none with bristles, where it acts at once."""
    return 0.0 if f.bristle_stiffness > 0.0 else f.viscous


@kernel
def runge_kutta(
    model: LegModel, effort_hip: float, effort_slide: float, dt_s: float, points: Vector
) -> int:
    """Like `semi_implicit`, by the classical fourth-order method."""
    outside = 0
    half_s = 0.5 * dt_s
    for j in range(points.size // STATE_COUNT):
        x = Motion(
            points[j],
            points[LANES + j],
            points[2 * LANES + j],
            points[3 * LANES + j],
            points[4 * LANES + j],
            points[5 * LANES + j],
        )
        u1 = effort_hip + points[6 * LANES + j]
        u2 = effort_slide + points[7 * LANES + j]
        k1, inside1 = _slope(model, u1, u2, x)
        k2, inside2 = _slope(model, u1, u2, _along(x, k1, half_s))
        k3, inside3 = _slope(model, u1, u2, _along(x, k2, half_s))
        k4, inside4 = _slope(model, u1, u2, _along(x, k3, dt_s))
        x = _along(_along(x, k1, dt_s / 6.0), k2, dt_s / 3.0)
        x = _along(_along(x, k3, dt_s / 3.0), k4, dt_s / 6.0)
        points[j] = x.q1
        points[LANES + j] = x.q2
        points[2 * LANES + j] = x.v1
        points[3 * LANES + j] = x.v2
        points[4 * LANES + j] = x.f1
        points[5 * LANES + j] = x.f2
        outside += 0 if inside1 and inside2 and inside3 and inside4 else 1
    return outside


class Motion(NamedTuple):
    """The six states that move within a step, or their rates: positions, velocities, frictions."""

    q1: Position
    q2: Position
    v1: Speed
    v2: Speed
    f1: Effort
    f2: Effort


@inline
def _slope(model: LegModel, u1: float, u2: float, x: Motion) -> tuple[Motion, bool]:
    a1, a2, inside = bounded_acceleration(
        model.leg, x.q1, x.q2, x.v1, x.v2, u1 - x.f1, u2 - x.f2, model.coriolis_share
    )
    rate1 = friction_rate(model.hip, x.f1, x.v1) + model.viscous_outside * model.hip.viscous * a1
    rate2 = (
        friction_rate(model.slide, x.f2, x.v2) + model.viscous_outside * model.slide.viscous * a2
    )
    return Motion(x.v1, x.v2, a1, a2, rate1, rate2), inside


@inline
def _along(x: Motion, rate: Motion, dt_s: float) -> Motion:
    return Motion(
        x.q1 + dt_s * rate.q1,
        x.q2 + dt_s * rate.q2,
        x.v1 + dt_s * rate.v1,
        x.v2 + dt_s * rate.v2,
        x.f1 + dt_s * rate.f1,
        x.f2 + dt_s * rate.f2,
    )
