"""FilterPy's unscented Kalman filter on the observer's model: the cost of a general library.

Its model is plain Python, as its users write it.
Spread (n + kappa = 3), noise and substeps are the observer's. The integrator is RK4, because with
the semi-implicit one FilterPy's covariance stops being positive definite after a few steps.
"""

import cmath
import math
from collections.abc import Callable

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from numpy.typing import NDArray

from observer.filter.leg_filter import Options, Setup
from observer.filter.leg_memory import START_STD
from observer.mechanism.friction import FrictionParameters
from observer.mechanism.parameters import GRAVITY, LegParameters

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Floats = list[float]
Slope = Callable[[Floats], Floats]


def run(setup: Setup, measured: Matrix, effort: Matrix, dt_s: float) -> Matrix:
    """State after each step, (n - 1, 8); the run begins at rest at the first measurement."""
    given, torque = np.asarray(setup)[0], np.zeros(2)
    model = python_model(setup, torque)
    points = MerweScaledSigmaPoints(n=8, alpha=1.0, beta=0.0, kappa=-5.0)
    peer = UnscentedKalmanFilter(
        dim_x=8, dim_z=2, dt=dt_s, hx=lambda x: x[:2], fx=model, points=points
    )
    peer.x = np.concatenate((measured[0], np.zeros(6)))
    peer.P = np.diag(np.square(START_STD))
    peer.Q = np.diag(np.square(given["process_std"]))
    peer.R = np.diag(np.square(given["measurement_std"]))
    states = np.empty((len(measured) - 1, 8))
    for k in range(1, len(measured)):
        torque[:] = effort[k]
        peer.predict()
        peer.update(measured[k])
        states[k - 1] = peer.x
    return states


def python_model(setup: Setup, torque: Vector) -> Callable[[Vector, float], Vector]:
    """Build one step for one point, scalar by scalar: small arrays would be slower."""
    given = np.asarray(setup)[0]
    leg = LegParameters(*given["leg"].tolist())
    hip, slide = (FrictionParameters(*given[axis].tolist()) for axis in ("hip", "slide"))
    coriolis_share = float(given["coriolis_share"])
    substeps = int(Options(*given["options"]).substeps)

    def slope(x: Floats) -> Floats:
        q1, q2, v1, v2, f1, f2, d1, d2 = x
        force = (float(torque[0]) + d1 - f1, float(torque[1]) + d2 - f2)
        a1, a2 = _acceleration(leg, coriolis_share, q1, q2, v1, v2, force)
        return [
            v1,
            v2,
            a1,
            a2,
            _friction_rate(hip, f1, v1),
            _friction_rate(slide, f2, v2),
            0.0,
            0.0,
        ]

    def step(x: Vector, dt_s: float) -> Vector:
        state = x.tolist()
        for _ in range(substeps):
            state = _runge_kutta(slope, state, dt_s / substeps)
        return np.array(state)

    return step


def _runge_kutta(slope: Slope, x: Floats, h: float) -> Floats:
    k1 = slope(x)
    k2 = slope([a + 0.5 * h * b for a, b in zip(x, k1, strict=True)])
    k3 = slope([a + 0.5 * h * b for a, b in zip(x, k2, strict=True)])
    k4 = slope([a + h * b for a, b in zip(x, k3, strict=True)])
    slopes = zip(x, k1, k2, k3, k4, strict=True)
    return [a + h / 6.0 * (b + 2.0 * c + 2.0 * d + e) for a, b, c, d, e in slopes]


def _friction_rate(f: FrictionParameters, friction: float, v: float) -> float:
    z = v / f.peak
    hump = f.stribeck - f.coulomb * math.tanh(f.peak / f.transition) - f.viscous * f.peak
    static = hump * z * math.exp(0.5 - 0.5 * z * z)
    static += f.coulomb * math.tanh(v / f.transition) + f.viscous * v
    return -math.expm1(-((v / f.edge) ** 2)) / f.time_constant_s * (static - friction)


def _acceleration(
    p: LegParameters,
    coriolis_share: float,
    q1: float,
    q2: float,
    v1: float,
    v2: float,
    force: tuple[float, float],
) -> tuple[float, float]:
    """Acceleration in complex numbers, as in the derivation: thigh K, shank u, shoe w."""
    thigh = cmath.rect(p.thigh_length_m, p.thigh_angle_rad + q1)
    rail = complex(p.rail_cos, p.rail_sin)
    reach = complex(p.rail_x_m, p.rail_y_m) + q2 * rail - thigh
    square = abs(reach) ** 2
    half = 0.5 * (p.shank_length_m**2 - p.shoe_length_m**2 + square)
    delta = -math.sqrt(max(p.shank_length_m**2 * square - half**2, p.smallest_delta**2))
    shank = complex(half, delta) / square * reach
    shoe = shank - reach
    shank_hip, shank_slide = -_cross(thigh, shoe) / delta, _dot(rail, shoe) / delta
    shoe_hip, shoe_slide = -_cross(thigh, shank) / delta, _dot(rail, shank) / delta

    moment1 = complex(p.thigh_moment_re, p.thigh_moment_im) * thigh
    moment2 = complex(p.shank_moment_re, p.shank_moment_im) * shank
    moment3 = complex(p.shoe_moment_re, p.shoe_moment_im) * shoe
    b12, b13, b23 = _dot(thigh, moment2), -_dot(thigh, moment3), -_dot(shank, moment3)
    e12, e13, e23 = _cross(thigh, moment2), -_cross(thigh, moment3), -_cross(shank, moment3)
    p2 = b12 + p.shank_inertia * shank_hip + b23 * shoe_hip
    p3 = b13 + p.shoe_inertia * shoe_hip + b23 * shank_hip
    m11 = p.thigh_inertia + b12 * shank_hip + b13 * shoe_hip + shank_hip * p2 + shoe_hip * p3
    m12 = shank_slide * p2 + shoe_slide * p3
    m22 = p.slide_inertia + p.shank_inertia * shank_slide**2 + p.shoe_inertia * shoe_slide**2
    m22 += 2.0 * b23 * shank_slide * shoe_slide

    rate2 = shank_hip * v1 + shank_slide * v2
    rate3 = shoe_hip * v1 + shoe_slide * v2
    s1, s2, s3 = (coriolis_share * rate**2 for rate in (v1, rate2, rate3))
    together = _dot(shank, shoe)
    alpha2 = (s1 * _dot(thigh, shoe) + s2 * together - s3 * p.shoe_length_m**2) / delta
    alpha3 = (s1 * _dot(thigh, shank) + s2 * p.shank_length_m**2 - s3 * together) / delta
    knee = p.knee_damping * (rate2 - v1)
    ankle = p.ankle_damping * (rate3 - rate2)
    f1 = b12 * alpha2 + b13 * alpha3 - s2 * e12 - s3 * e13 + p.hip_damping * v1 - knee
    f1 += GRAVITY * moment1.real + p.hip_stiffness * (q1 - p.hip_rest_rad)
    f2 = p.shank_inertia * alpha2 + b23 * alpha3 + s1 * e12 - s3 * e23
    f2 += GRAVITY * moment2.real + knee - ankle
    f3 = b23 * alpha2 + p.shoe_inertia * alpha3 + s1 * e13 + s2 * e23
    f3 += ankle + p.slide_joint_damping * rate3 - GRAVITY * moment3.real
    n1 = force[0] - f1 - shank_hip * f2 - shoe_hip * f3
    n2 = force[1] - p.slide_weight_n - shank_slide * f2 - shoe_slide * f3
    n2 -= p.slide_stiffness * (q2 - p.slide_rest_m)
    determinant = m11 * m22 - m12 * m12
    return (m22 * n1 - m12 * n2) / determinant, (m11 * n2 - m12 * n1) / determinant


def _cross(a: complex, b: complex) -> float:
    return (a.conjugate() * b).imag


def _dot(a: complex, b: complex) -> float:
    return (a.conjugate() * b).real
