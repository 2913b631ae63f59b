"""The likelihood of a recording: of each innovation z with variance s, (z^2 / s + log s) / 2.

Its gradient and its expected curvature (Fisher's information) need first derivatives only:

    g_i  = sum( dz_i z / s + ds_i (1 - z^2 / s) / (2 s) )
    I_ij = sum( dz_i dz_j / s + ds_i ds_j / (2 s^2) )

Derivatives are differences of whole filter runs. Weak priors bound a search where the recording has
no information; intervals include none of them but that of the timing of efforts.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.innovations import KalmanRows, KalmanTuning, innovations
from analysis.calibration.motion import Motion
from analysis.calibration.quantities import (
    LAW_SIZE,
    NOISE,
    OF_LAW_11,
    SIZE,
    SLOPE_SCALE,
    SLOPES,
    TIMING,
    Frame,
    noise_of,
    offsets_of,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Flags = NDArray[np.bool_]

SUBSTEPS: Final = 3
FINE_SUBSTEPS: Final = 8
"""Where the shape of the law near standstill counts: with 3 it is a few percent off."""
DIFFERENCE: Final = 1e-4
"""Step of a free value."""
WIDTH: Final = np.array([1e-5, 1e-5, 1e-5, 5e-6, 1e-3, 1e-2])
SPREAD: Final = np.array([0.02, 0.01, 0.5, 5.0])
PRIOR_LEVEL: Final = 3.0
PRIOR_SPEED: Final = 1.0
"""Standard deviations of free values about the initial ones, factors of e: levels and noise; speeds
and time constants of the law."""
PRIOR_TIMING: Final = 1.0
"""Standard deviation of timing, ms: what a drive says of an effort is about as old as it says. As a
measured fact of drives it is the one prior that intervals include."""
STEEPER_MAX: Final = 4.0
SMOOTHER_MAX: Final = 30.0
"""Limits of the law's speeds as factors on the file's."""
HUMP_MAX_RATIO: Final = 1.0
"""Limit of the hump, in Coulomb levels."""
SLOPE_MAX: Final = 2.0
"""Limit of a slope, 1/rad or 1/m: no robot file may have more."""
EFFORT_NOISE_MIN_RATIO: Final = 0.005
"""Least noise of effort, in Coulomb levels: no drive shows its torque better, and without noise a
recording would be one path, which no law follows and no interval covers."""
BLOCK_ROWS: Final = (50, 100, 200, 400)
"""Innovations close in time are not independent, and how long is not known: scores are summed over
blocks of each length, of half a second to four, and the widest result counts."""
REST_NOISE_RATIO: Final = 0.03
"""Over the Coulomb level, per row: rate of change of the friction that holds a resting axis."""
CLIP: Final = 36.0
"""Limit of z^2 / s: a single shock must not distort the law."""


@dataclass(frozen=True, slots=True, eq=False)
class Surprises:
    """The innovations and variances that count, shape (m,)."""

    z: Vector
    s: Vector

    @property
    def loss(self) -> float:
        """Negative log likelihood without its constant; NaN where no motion can be computed."""
        with np.errstate(invalid="ignore", over="ignore"):
            return float(0.5 * np.sum(np.minimum(self.z**2 / self.s, CLIP) + np.log(self.s)))


class Likelihood:
    """Likelihood of a motion as a function of free values; the last runs are cached."""

    def __init__(self, frame: Frame, motion: Motion, rows: Flags, substeps: int = SUBSTEPS) -> None:
        """Score the settled part of `rows`, shape (n,)."""
        self.frame = frame
        self.motion = motion
        self.substeps = substeps
        self._effort_rate = motion.effort_rate
        self.counted = (rows & motion.settled)[:, None] & ~np.isnan(motion.position)
        self.counted &= ~motion.rests
        self._z = np.empty(motion.position.shape)
        self._s = np.empty(motion.position.shape)
        self.row = np.nonzero(self.counted)[0]

    def surprises(self, free: Vector) -> Surprises:
        """Run the filter once."""
        natural = self.frame.from_free(free)
        motion = self.motion
        innovations(
            self.frame.model_of(natural),
            KalmanTuning(
                noise=noise_of(natural),
                rest_noise=REST_NOISE_RATIO * natural[[0, LAW_SIZE]],
                spread=SPREAD,
                width=WIDTH,
                substeps=self.substeps,
                over=self.frame.over_of(natural),
            ),
            KalmanRows(
                steps_s=motion.steps_s,
                position=motion.position,
                effort=motion.effort - offsets_of(natural) - natural[TIMING:] * self._effort_rate,
                begins=motion.begins,
                rests=motion.rests,
                starts=motion.smooth,
            ),
            self._z,
            self._s,
        )
        return Surprises(self._z[self.counted], self._s[self.counted])

    def derivatives(
        self, free: Vector, which: NDArray[np.intp]
    ) -> tuple[Surprises, Matrix, Matrix]:
        """Return the innovations, and dz and ds per free value, (m, k)."""
        base = self.surprises(free)
        dz, ds = np.empty((len(base.z), len(which))), np.empty((len(base.z), len(which)))
        for column, index in enumerate(which):
            beside = free.copy()
            beside[index] += DIFFERENCE
            run = self.surprises(beside)
            with np.errstate(invalid="ignore", over="ignore"):
                dz[:, column] = (run.z - base.z) / DIFFERENCE
                ds[:, column] = (run.s - base.s) / DIFFERENCE
        return base, dz, ds


def scores(base: Surprises, dz: Matrix, ds: Matrix) -> tuple[Matrix, Matrix]:
    """Gradient of each innovation, shape (m, k), and Fisher's information, shape (k, k)."""
    ratio = base.z**2 / base.s
    kept = (ratio < CLIP)[:, None]
    z, s = base.z[:, None], base.s[:, None]
    each = kept * dz * z / s + ds * (1.0 - kept * ratio[:, None]) / (2.0 * s)
    by_mean, by_spread = kept * dz / np.sqrt(s), ds / (np.sqrt(2.0) * s)
    return each, by_mean.T @ by_mean + by_spread.T @ by_spread


def prior_std() -> Vector:
    """Standard deviations of free values about the initial ones, shape (SIZE,)."""
    std = np.full(SIZE, PRIOR_LEVEL)
    for axis in range(2):
        std[axis * LAW_SIZE : (axis + 1) * LAW_SIZE][OF_LAW_11] = PRIOR_SPEED
    std[NOISE:TIMING] = PRIOR_LEVEL
    std[TIMING:] = PRIOR_TIMING
    return std


def bounds(frame: Frame) -> tuple[Vector, Vector]:
    """Least and greatest free values, shape (SIZE,) each; most have none.

    Bristles would be fitted by an eq. (11) that is ever steeper at rest, which does not describe
    motion and which no observer at 10 ms can follow. An unbounded hump is of no use
    either: behind it the likelihood is rough and has many local optima. A law that is smoother than
    the file's does no harm.
    """
    middle = frame.free(frame.natural)
    low, high = np.full(SIZE, -np.inf), np.full(SIZE, np.inf)
    for axis in range(2):
        coulomb = frame.natural[axis * LAW_SIZE]
        low[NOISE + 2 + axis] = np.log(EFFORT_NOISE_MIN_RATIO * coulomb)
        hump, speeds, time = (axis * LAW_SIZE + at for at in (1, 3, 6))
        high[hump] = max(middle[hump], np.log(HUMP_MAX_RATIO))
        low[speeds : time + 1] = middle[speeds : time + 1] - np.log(STEEPER_MAX)
        high[speeds:time] = middle[speeds:time] + np.log(SMOOTHER_MAX)
        high[time] = middle[time] + np.log(STEEPER_MAX)
        low[SLOPES[axis]], high[SLOPES[axis]] = -SLOPE_MAX / SLOPE_SCALE, SLOPE_MAX / SLOPE_SCALE
    return low, high


def robust_covariance(each: Matrix, fisher: Matrix, rows: NDArray[np.intp]) -> Matrix:
    """Covariance of estimates: Huber's sandwich over blocks of rows, never below Fisher's own.

    The widest of all lengths of blocks counts, for each value by itself.
    """
    inverse = np.linalg.pinv(fisher, hermitian=True)
    plain = np.maximum(np.diag(inverse), 1e-300)
    widest = np.ones(len(plain))
    for length in BLOCK_ROWS:
        blocks = rows // length
        edges = np.flatnonzero(np.diff(blocks, prepend=blocks[0] - 1))
        moved = np.add.reduceat(each, edges, axis=0) @ inverse
        widest = np.maximum(widest, np.sum(moved**2, axis=0) / plain)
    wider = np.sqrt(widest)
    made: Matrix = np.asarray(inverse * np.outer(wider, wider), dtype=np.float64)
    return made
