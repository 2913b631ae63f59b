"""Initial values: effort that neither inertia nor weight explains is friction.

At speed that is linear in the unknown numbers, so a regression over the smoothed motion finds them
independently of the file. Slow motion, where the law is nonlinear, is left to the likelihood.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.motion import REST, Motion
from analysis.calibration.quantities import (
    LAW_SIZE,
    OFFSETS,
    SLOPES,
    SPRINGS,
    Frame,
    law_of,
    offsets_of,
)
from observer.jit import kernel
from observer.mechanism.friction import smallest_stribeck
from observer.mechanism.linkage import dynamics
from observer.mechanism.parameters import LegParameters

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

FAST: Final = (0.15, 0.05)
MOVES_MIN_S: Final = 2.0
"""An axis with less total time of motion does not count as moving."""
MOVES_MIN: Final = (0.05, 0.02)
"""Nor does one with a smaller range, rad and m."""
START_SLOPE_MAX: Final = 1.0
"""Largest slope of friction to begin with, 1/rad or 1/m."""


@kernel
def residual_effort(
    leg: LegParameters, coriolis_share: float, smooth: Matrix, effort: Matrix, left: Matrix
) -> None:
    """Write the residual effort after inertia, weight, springs and dampers, (n, 2), to `left`."""
    for row in range(smooth.shape[0]):
        q1, q2, v1, v2, a1, a2 = smooth[row]
        d = dynamics(leg, q1, q2, v1, v2, coriolis_share)
        left[row, 0] = effort[row, 0] - d.m11 * a1 - d.m12 * a2 - d.bias_hip
        left[row, 1] = effort[row, 1] - d.m12 * a1 - d.m22 * a2 - d.bias_slide


class Extent(NamedTuple):
    """Extent of an axis' motion."""

    range_si: float
    top_speed_si: float
    moving_s: float
    reversal_count: int

    def enough(self, axis: int) -> bool:
        """True if its friction can be identified."""
        return self.moving_s >= MOVES_MIN_S and self.range_si >= MOVES_MIN[axis]


def extent(motion: Motion, axis: int) -> Extent:
    """Extent of an axis' motion, from the smoothed motion."""
    velocity = motion.velocity[:, axis]
    moving = np.abs(velocity) > REST[axis]
    signs = np.sign(velocity[np.abs(velocity) > FAST[axis] / 2])
    place = motion.smooth[:, axis]
    return Extent(
        float(np.ptp(place)),
        float(np.quantile(np.abs(velocity), 0.999)),
        float(np.sum(motion.steps_s[moving])),
        int(np.count_nonzero(np.diff(signs))),
    )


def left_over(frame: Frame, natural: Vector, motion: Motion) -> Matrix:
    """Effort that the mechanism of these values leaves to friction, shape (n, 2): N·m and N."""
    left = np.empty((len(motion.steps_s), 2))
    effort = motion.smooth_effort - offsets_of(natural)
    residual_effort(frame.leg_of(natural), frame.coriolis_share, motion.smooth, effort, left)
    return left


def regressed(frame: Frame, motion: Motion, hump_ratio: float) -> Vector:
    """Natural values, shape (SIZE,), by linear least squares of the inverse dynamics.

    For each axis that moves: Coulomb friction with its slope, viscous friction, the drive's
    inertia, and the effort and stiffness of its spring or the drive's offset, over the rows too
    fast for the rest of the law. Its hump is `hump_ratio` of the Coulomb level. Everything else is
    taken from the file.
    """
    natural = frame.natural.copy()
    left = left_over(frame, natural, motion)
    for axis in range(2):
        if extent(motion, axis).enough(axis):
            _regress_axis(frame, natural, motion, left[:, axis], axis, hump_ratio)
    return natural


def _regress_axis(
    frame: Frame, natural: Vector, motion: Motion, left: Vector, axis: int, hump_ratio: float
) -> None:
    """Regress one axis into `natural`, from the residual effort with the file's values."""
    velocity, speed = motion.velocity[:, axis], np.abs(motion.velocity[:, axis])
    moving = (speed > REST[axis]) & motion.settled & ~motion.held_out
    fast = moving & (speed > min(FAST[axis], float(np.quantile(speed[moving], 0.5))))
    columns = np.zeros((np.count_nonzero(fast), 6))
    columns[:, :3] = np.column_stack((np.sign(velocity), velocity, np.ones(len(velocity))))[fast]
    if frame.sprung(axis):
        columns[:, 3] = motion.smooth[fast, axis] - frame.middle[axis]
    columns[:, 4] = motion.smooth[fast, 4 + axis]
    columns[:, 5] = columns[:, 0] * (motion.smooth[fast, axis] - frame.over[axis].middle)
    # Minimum norm: a column of zeros gets 0.
    found, *_ = np.linalg.lstsq(columns, left[fast], rcond=None)
    law, at = natural[axis * LAW_SIZE : (axis + 1) * LAW_SIZE], SPRINGS + 3 * axis
    law[0] = max(float(found[0]), 0.2 * float(np.median(np.abs(left[fast]))), 1e-3)
    law[2] = max(float(found[1]), 0.01 * law[0])
    law[1] = smallest_stribeck(law_of(natural, axis)) + hump_ratio * law[0]
    natural[SLOPES[axis]] = np.clip(found[5] / law[0], -START_SLOPE_MAX, START_SLOPE_MAX)
    if frame.sprung(axis):
        stiffness = natural[at]
        effort = stiffness * (frame.middle[axis] - natural[at + 1]) + found[2]
        natural[at] = max(stiffness + found[3], 0.05 * stiffness)
        natural[at + 1] = frame.middle[axis] - effort / natural[at]
    else:
        natural[OFFSETS[axis]] += found[2]
    natural[at + 2] = max(natural[at + 2] + found[4], 0.0)
