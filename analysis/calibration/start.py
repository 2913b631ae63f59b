"""A first guess by regression: what of the torque neither inertia nor weight explains is friction.

Along the smoothed motion the friction of (11) to (13) is a known function of its parameters; where
an axis rests, friction is whatever holds it, so the memory there is taken from the torque itself.
Several speeds are tried to begin with, because the law's valleys are narrow.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from analysis.calibration.motion import REST, Motion, smoothed
from analysis.calibration.quantities import LAW_SIZE, SPRINGS, Frame, law_of
from observer.friction import FrictionParameters, friction_after
from observer.jit import kernel
from observer.linkage import dynamics
from observer.parameters import LegParameters

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

FAST: Final = (0.15, 0.05)
MOVES_MIN_S: Final = 2.0
"""An axis that moves for less than this in all does not move."""
MOVES_MIN: Final = (0.05, 0.02)
"""Nor one with a smaller range, rad and m."""
SPEED_FACTORS: Final = (0.5, 1.0, 2.0)


@kernel
def unexplained(
    leg: LegParameters, coriolis_share: float, smooth: Matrix, effort: Matrix, left: Matrix
) -> None:
    """What inertia, weight, springs and dampers leave of the effort, shape (n, 2), into `left`."""
    for row in range(smooth.shape[0]):
        q1, q2, v1, v2, a1, a2 = smooth[row]
        d = dynamics(leg, q1, q2, v1, v2, coriolis_share)
        left[row, 0] = effort[row, 0] - d.m11 * a1 - d.m12 * a2 - d.bias_hip
        left[row, 1] = effort[row, 1] - d.m12 * a1 - d.m22 * a2 - d.bias_slide


@kernel
def _friction_along(
    f: FrictionParameters, velocity: Vector, left: Vector, rest: float, steps_s: Vector, out: Vector
) -> None:
    friction = 0.0
    for row in range(velocity.size):
        if abs(velocity[row]) < rest:
            friction = left[row]
        else:
            mean = 0.5 * (velocity[row] + velocity[max(row - 1, 0)])
            friction = friction_after(f, friction, mean, steps_s[row])
        out[row] = friction


class Moved(NamedTuple):
    """How an axis moved."""

    range_si: float
    top_speed_si: float
    moving_s: float
    reversal_count: int

    def enough(self, axis: int) -> bool:
        """Whether its friction can be told at all."""
        return self.moving_s >= MOVES_MIN_S and self.range_si >= MOVES_MIN[axis]


def moved(motion: Motion, axis: int) -> Moved:
    """How an axis moved, from the smoothed motion."""
    velocity = motion.velocity[:, axis]
    moving = np.abs(velocity) > REST[axis]
    signs = np.sign(velocity[np.abs(velocity) > FAST[axis] / 2])
    place = motion.smooth[:, axis]
    return Moved(
        float(np.ptp(place)),
        float(np.quantile(np.abs(velocity), 0.999)),
        float(np.sum(motion.steps_s[moving])),
        int(np.count_nonzero(np.diff(signs))),
    )


def left_over(frame: Frame, natural: Vector, motion: Motion) -> Matrix:
    """Shape (n, 2): the effort that the mechanism of these values leaves to friction, N·m and N."""
    left = np.empty((len(motion.steps_s), 2))
    leg = frame.leg_of(natural)
    unexplained(leg, frame.coriolis_share, motion.smooth, motion.smooth_effort, left)
    return left


def guess(frame: Frame, motion: Motion) -> Vector:
    """Natural values, shape (SIZE,): the file's where an axis does not move, else regressed."""
    natural = frame.natural.copy()
    left = left_over(frame, natural, motion)
    for axis in range(2):
        if moved(motion, axis).enough(axis):
            natural = _guess_axis(frame, natural, motion, left[:, axis], axis)
    return natural


def _guess_axis(frame: Frame, natural: Vector, motion: Motion, left: Vector, axis: int) -> Vector:
    velocity = np.ascontiguousarray(motion.velocity[:, axis])
    place = motion.smooth[:, axis] - frame.middle[axis]
    moving = (np.abs(velocity) > REST[axis]) & motion.settled & ~motion.held_out
    coulomb, viscous, offset, slope = _straight(velocity, place, left, moving, axis)
    law = slice(axis * LAW_SIZE, (axis + 1) * LAW_SIZE)
    scale = 0.02 * coulomb
    best: tuple[float, Vector] | None = None
    out = np.empty(len(velocity))

    def differences(free: Vector) -> Vector:
        trial = frame.free(natural)
        trial[law] = free[:LAW_SIZE]
        f = law_of(frame.from_free(trial), axis)
        held = left - free[LAW_SIZE] * coulomb - free[LAW_SIZE + 1] * coulomb * place
        _friction_along(f, velocity, held, REST[axis], motion.steps_s, out)
        return ((smoothed(out) - held) / scale)[moving]

    for factor in SPEED_FACTORS:
        trial = natural.copy()
        levels = trial[law]
        levels[:3] = coulomb, 1.15 * coulomb + viscous * factor * levels[4], viscous
        levels[3:6] *= factor
        begin = np.append(frame.free(trial)[law], (offset / coulomb, slope / coulomb))
        reach = np.array([1.5, 4.0, 3.0, 2.0, 1.5, 2.0, 2.0, np.inf, np.inf])
        found = least_squares(
            differences, begin, bounds=(begin - reach, begin + reach), loss="soft_l1", max_nfev=25
        )
        if best is None or found.cost < best[0]:
            best = (float(found.cost), found.x)
    assert best is not None  # noqa: S101 - three were tried
    return _with_law(frame, natural, best[1], axis, coulomb)


def _with_law(frame: Frame, natural: Vector, found: Vector, axis: int, coulomb: float) -> Vector:
    """Friction as found; the offset and slope over position are the spring's."""
    free = frame.free(natural)
    free[axis * LAW_SIZE : (axis + 1) * LAW_SIZE] = found[:LAW_SIZE]
    made = frame.from_free(free)
    at = SPRINGS + 3 * axis
    stiffness, rest = made[at], made[at + 1]
    effort = stiffness * (frame.middle[axis] - rest) + found[LAW_SIZE] * coulomb
    made[at] = max(stiffness + found[LAW_SIZE + 1] * coulomb, 0.05 * stiffness, 1e-3)
    made[at + 1] = frame.middle[axis] - effort / made[at]
    return made


def _straight(
    velocity: Vector, place: Vector, left: Vector, moving: NDArray[np.bool_], axis: int
) -> tuple[float, float, float, float]:
    """Coulomb, viscous, offset, slope by a line through what is fast enough."""
    speed = np.abs(velocity)
    fast = moving & (speed > min(FAST[axis], float(np.quantile(speed[moving], 0.5))))
    ones = np.ones(np.count_nonzero(fast))
    columns = np.column_stack((np.sign(velocity[fast]), velocity[fast], ones, place[fast]))
    found, *_ = np.linalg.lstsq(columns, left[fast], rcond=None)
    coulomb = max(float(found[0]), 0.2 * float(np.median(np.abs(left[fast]))), 1e-3)
    viscous = max(float(found[1]), 0.01 * coulomb)
    return coulomb, viscous, float(found[2]), float(found[3])
