"""Closed form of the two-coordinate leg: geometry, inertia, gravity, Coriolis, dampers, springs.

The hip is the origin, x forward, y up. The thigh K ends at the knee, the shank u at the ankle A,
the shoe w runs from the slide joint S to the ankle; S moves on a straight rail. The ankle is the
intersection of two circles, on the branch with the knee flexed. Four moving links and five joints
leave two degrees of freedom, q = (hip angle, slide position).

In the angular rates of the links (thigh 1, shank 2, shoe 3), which follow from q' by the closure
condition K + u = S + w, all terms are short and need no second derivatives:

    inertia     M = W' B W + diag(0, slide)     W = d(rates)/dq', B(q) couples the links
    gravity     g = W' G + springs
    bias        c = W' (B alpha + h)            alpha: the links' angular acceleration at q'' = 0,
                                                h: centripetal coupling of the links
    dampers     D = W' d(joint rates)

which are M, g, c and C~ q' of the paper's eq. (6), with the Coriolis part that the paper omits.

Where the circles do not meet, the functions for callers in Python raise `WorkspaceError`; those for
filters and plants continue with shank and shoe held at SMALLEST_RATIO and return a flag, because a
sigma point may be outside the workspace without harm. None returns NaN.

Functions that are called in every cycle take `leg`, the parameters as a plain tuple: numba reads it
four times faster than a named one.

Symbols: p parameters, q (hip angle rad, slide position m), dq their rates; effort, friction: hip
N m, slide N. Angles in rad, counter-clockwise and flexion positive.
"""

import math

import numpy as np
from numpy.typing import NDArray

from observer.jit import inline, kernel
from observer.mechanism.elementary import cos_sin
from observer.mechanism.linkage import Dynamics, Pose, dynamics, pose
from observer.mechanism.parameters import LegParameters

Vector = NDArray[np.float64]


class WorkspaceError(ValueError):
    """The circles about knee and slide joint do not meet: no such pose exists."""


@inline
def _ratio(p: LegParameters, at: Pose) -> float:
    return -at.delta / (p.shank_length_m * p.shoe_length_m) if at.closes else 0.0


@kernel
def singularity_ratio(p: LegParameters, q: Vector) -> float:
    """|sin| of the angle between shank and shoe: 0 where it is singular, or no pose exists."""
    return _ratio(p, pose(p, q[0], q[1]))


@kernel
def knee_angle(p: LegParameters, q: Vector) -> float:
    """Knee flexion, rad: from the thigh's line to the shank's line, clockwise positive.

    Raises:
        WorkspaceError: no pose exists at q.
    """
    at = _closed_pose(p, q)
    cross = at.knee_x * at.shank_y - at.knee_y * at.shank_x
    return -math.atan2(cross, at.knee_x * at.shank_x + at.knee_y * at.shank_y)


@kernel
def slide_position_for_knee(
    leg: tuple[float, ...], hip_angle_rad: float, knee_angle_rad: float
) -> float:
    """Slide position, m, at which the leg has this hip angle and this knee flexion.

    Raises:
        WorkspaceError: the rail is out of the shoe's reach there.
    """
    p = LegParameters(*leg)
    cosine, sine = cos_sin(p.thigh_angle_rad + hip_angle_rad)
    shank_cos, shank_sin = cos_sin(p.thigh_angle_rad + hip_angle_rad - knee_angle_rad)
    shank_x = p.shank_length_m * shank_cos
    shank_y = p.shank_length_m * shank_sin
    # In the rail's frame: the ankle from the rail's origin, and the shank.
    x = p.thigh_length_m * cosine + shank_x - p.rail_x_m
    y = p.thigh_length_m * sine + shank_y - p.rail_y_m
    ankle_along = x * p.rail_cos + y * p.rail_sin
    ankle_across = y * p.rail_cos - x * p.rail_sin
    shank_along = shank_x * p.rail_cos + shank_y * p.rail_sin
    shank_across = shank_y * p.rail_cos - shank_x * p.rail_sin
    reach2 = p.shoe_length_m * p.shoe_length_m - ankle_across * ankle_across
    if reach2 < 0.0:
        raise WorkspaceError("the shoe does not reach the rail at these hip and knee angles")
    # Toes forward first; the right pose is the one with negative cross(u, w).
    for reach in (math.sqrt(reach2), -math.sqrt(reach2)):
        if shank_along * ankle_across + shank_across * reach < 0.0:
            return ankle_along + reach
    raise WorkspaceError("no slide position gives these hip and knee angles on the knee's branch")


@kernel
def mass_matrix(p: LegParameters, q: Vector) -> Vector:
    """M(q), shape (2, 2): kg m^2, kg m, kg.

    Raises:
        WorkspaceError: no pose exists at q.
    """
    d = _closed_dynamics(p, q, np.zeros(2), 0.0)
    return np.array([[d.m11, d.m12], [d.m12, d.m22]])


@kernel
def gravity(p: LegParameters, q: Vector) -> Vector:
    """g(q) with the springs, shape (2,): the torque N m and force N that hold the leg at rest.

    Raises:
        WorkspaceError: no pose exists at q.
    """
    d = _closed_dynamics(p, q, np.zeros(2), 0.0)
    return np.array([d.bias_hip, d.bias_slide])


@kernel
def ratio_and_load(leg: tuple[float, ...], hip: float, slide: float) -> tuple[float, float, float]:
    """`singularity_ratio` and the parts of `gravity` in one call; all 0 where no pose exists."""
    p = LegParameters(*leg)
    at = pose(p, hip, slide)
    if not at.closes:
        return 0.0, 0.0, 0.0
    d = dynamics(p, hip, slide, 0.0, 0.0, 0.0)
    return _ratio(p, at), d.bias_hip, d.bias_slide


@kernel
def smallest_inertia(p: LegParameters, ratio: float) -> tuple[float, float]:
    """Least effective inertia of hip kg m^2 and slide kg where |sin| exceeds `ratio`.

    The inertia of one axis when the other is free: det M / M22 and det M / M11. The grid covers all
    poses of a hip from -90 to 90 degrees and a slide within the leg's reach.
    """
    reach = p.thigh_length_m + p.shank_length_m + p.shoe_length_m
    smallest1 = p.thigh_inertia + p.shank_inertia + p.shoe_inertia
    smallest2 = math.inf
    limit = ratio * p.shank_length_m * p.shoe_length_m
    for hip in np.linspace(-0.5 * math.pi, 0.5 * math.pi, 91):
        for slide in np.linspace(-2.0 * reach, 2.0 * reach, 181):
            if -pose(p, hip, slide).delta > limit:
                d = dynamics(p, hip, slide, 0.0, 0.0, 0.0)
                determinant = d.m11 * d.m22 - d.m12 * d.m12
                smallest1 = min(smallest1, determinant / d.m22)
                smallest2 = min(smallest2, determinant / d.m11)
    return smallest1, smallest2


@inline
def _closed_pose(p: LegParameters, q: Vector) -> Pose:
    at = pose(p, q[0], q[1])
    if not at.closes:
        raise WorkspaceError("shank and shoe do not reach each other: no pose exists there")
    return at


@inline
def _closed_dynamics(p: LegParameters, q: Vector, dq: Vector, coriolis_share: float) -> Dynamics:
    _closed_pose(p, q)
    return dynamics(p, q[0], q[1], dq[0], dq[1], coriolis_share)
