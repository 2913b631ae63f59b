"""Quantities of the mechanism that only tests use: positions, parts of the bias, energies."""

import numpy as np

from observer.jit import kernel
from observer.mechanism.linkage import bounded_acceleration, pose
from observer.mechanism.mechanism import Vector, _closed_dynamics, _closed_pose
from observer.mechanism.parameters import GRAVITY, LegParameters


@kernel
def closes(p: LegParameters, hip: float, slide: float) -> bool:
    """True if a pose exists at these coordinates: the circles about knee and slide joint meet."""
    return pose(p, hip, slide).closes


@kernel
def joint_positions(p: LegParameters, q: Vector) -> Vector:
    """Hip, knee, ankle, slide joint in the world, m, shape (4, 2), for drawings.

    Raises:
        WorkspaceError: no pose exists at q.
    """
    at = _closed_pose(p, q)
    points = np.zeros((4, 2))
    points[1] = at.knee_x, at.knee_y
    points[2] = at.knee_x + at.shank_x, at.knee_y + at.shank_y
    points[3] = points[2, 0] - at.shoe_x, points[2, 1] - at.shoe_y
    return points


@kernel
def coriolis(p: LegParameters, q: Vector, dq: Vector) -> Vector:
    """c(q, q'), shape (2,): Coriolis and centrifugal torque N m and force N.

    Raises:
        WorkspaceError: no pose exists at q.
    """
    full = _closed_dynamics(p, q, dq, 1.0)
    without = _closed_dynamics(p, q, dq, 0.0)
    return np.array([full.bias_hip - without.bias_hip, full.bias_slide - without.bias_slide])


@kernel
def damping(p: LegParameters, q: Vector, dq: Vector) -> Vector:
    """C~(q) q', shape (2,): torque N m and force N of the joints' dampers.

    Raises:
        WorkspaceError: no pose exists at q.
    """
    moving = _closed_dynamics(p, q, dq, 0.0)
    resting = _closed_dynamics(p, q, np.zeros(2), 0.0)
    return np.array([moving.bias_hip - resting.bias_hip, moving.bias_slide - resting.bias_slide])


@kernel
def acceleration(
    p: LegParameters, q: Vector, dq: Vector, effort: Vector, friction: Vector, full: bool
) -> Vector:
    """Acceleration q'', eq. (6), shape (2,): rad/s^2, m/s^2; without Coriolis unless `full`.

    Raises:
        WorkspaceError: no pose exists at q.
    """
    _closed_pose(p, q)
    share = 1.0 if full else 0.0
    a1, a2, _ = bounded_acceleration(
        p, q[0], q[1], dq[0], dq[1], effort[0] - friction[0], effort[1] - friction[1], share
    )
    return np.array([a1, a2])


@kernel
def kinetic_energy(p: LegParameters, q: Vector, dq: Vector) -> float:
    """T = q' M q' / 2, J.

    Raises:
        WorkspaceError: no pose exists at q.
    """
    d = _closed_dynamics(p, q, dq, 0.0)
    return 0.5 * (d.m11 * dq[0] * dq[0] + d.m22 * dq[1] * dq[1]) + d.m12 * dq[0] * dq[1]


@kernel
def potential_energy(p: LegParameters, q: Vector) -> float:
    """V(q) of weights and springs, J; the hip's height is 0; eq. (3).

    Raises:
        WorkspaceError: no pose exists at q.
    """
    at = _closed_pose(p, q)
    height = p.thigh_moment_re * at.knee_y + p.thigh_moment_im * at.knee_x
    height += p.shank_moment_re * at.shank_y + p.shank_moment_im * at.shank_x
    height -= p.shoe_moment_re * at.shoe_y + p.shoe_moment_im * at.shoe_x
    weight = GRAVITY * height + p.slide_weight_n * q[1]
    if p.rail_sin != 0.0:
        weight += p.slide_weight_n / p.rail_sin * p.rail_y_m
    hip = q[0] - p.hip_rest_rad
    slide = q[1] - p.slide_rest_m
    return weight + 0.5 * (p.hip_stiffness * hip * hip + p.slide_stiffness * slide * slide)
