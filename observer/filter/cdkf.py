"""Central difference Kalman filter in square-root form: Appendix A of the paper.

Conventions that the paper leaves open, each checked by a test:
- S is lower triangular with P = S S' and a diagonal >= 0, so logs and golden vectors are unique.
- The model is a map over one time step, not a derivative.
- Sigma points are x and x +- h S's columns; they are drawn again for every use.
- A wide matrix A becomes the lower triangular L with A A' = L L' by Householder reflections of its
  rows. Nothing is ever subtracted from a covariance, so none can become indefinite.
- sigma_4 = 3, the fourth moment of a Gaussian, apart from h: variances of quadratics are exact.
- Process and measurement noise are additive, given as standard deviations per step.

Points lie state by state, `points[state * lanes + point]`, with `lanes` >= 2 n + 1: a model that
runs over the points of one state after the other becomes vector code. Point 0 is the mean, 1..n
and n+1..2n are the two sides. The rest is filled with the mean.

`spread` and `compress` are the time update around a model; `innovate` and `correct` the update by
measured states, which needs no sigma points. The caller provides scratch memory.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.jit import inline

SIGMA_4: Final = 3.0
STEP: Final = math.sqrt(3.0)
"""h: optimal for a Gaussian state."""

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


@inline
def spread(mean: Vector, root: Matrix, step: float, n: int, lanes: int, points: Vector) -> None:
    """Draw the 2 n + 1 sigma points of N(mean, root root') into `points`."""
    for row in range(n):
        base = row * lanes
        for lane in range(2 * n + 1, lanes):
            points[base + lane] = mean[row]
        points[base] = mean[row]
        for column in range(n):
            reach = step * root[row, column]
            points[base + 1 + column] = mean[row] + reach
            points[base + 1 + n + column] = mean[row] - reach


@inline
def compress(
    points: Vector,
    noise_root: Matrix,
    step: float,
    n: int,
    lanes: int,
    mean: Vector,
    root: Matrix,
    work: Vector,
) -> None:
    """Mean and root of propagated points with additive noise.

    Args:
        points: sigma points after the model, (n * lanes).
        noise_root: lower triangular root of this step's process noise, (n, n).
        step: h of the sigma points.
        n: number of states.
        lanes: points per state in memory.
        mean: result, (n).
        root: result, (n, n).
        work: scratch, (3 n n) at least.
    """
    columns = 3 * n
    first = 0.5 / step
    second = math.sqrt(SIGMA_4 - 1.0) * 0.5 / (step * step)
    share = 0.5 / (step * step)
    for row in range(n):
        base = row * lanes
        to = row * columns
        centre = points[base]
        total = 0.0
        for i in range(n):
            plus = points[base + 1 + i] - centre
            minus = points[base + 1 + n + i] - centre
            work[to + i] = first * (plus - minus)
            work[to + n + i] = second * (plus + minus)
            work[to + 2 * n + i] = noise_root[row, i] if i <= row else 0.0
            total += plus + minus
        mean[row] = centre + share * total
    triangularise(work, n, columns, 2 * n, 0, root)


@inline
def triangularise(work: Vector, n: int, columns: int, dense: int, lead: int, root: Matrix) -> None:
    """Write L with L L' = A A' to the lower triangle of `root` (n, n); A is in `work`, row by row.

    Columns from `dense` on have zeros above a diagonal that begins in row `lead`; they stay out of
    the rows that they do not reach. A full matrix has `dense` = `columns`.
    """
    for row in range(n):
        base = row * columns
        end = min(max(dense + row + 1 - lead, dense), columns)
        squares = 0.0
        for k in range(base + row, base + end):
            squares += work[k] * work[k]
        length = math.sqrt(squares)
        root[row, row] = length
        pivot = work[base + row]
        # The reflection that takes this row to (-sign(pivot) length, 0, ...): no cancellation.
        side = math.copysign(1.0, pivot)
        over = 1.0 / (squares + abs(pivot) * length) if squares > 0.0 else 0.0
        work[base + row] = pivot + side * length
        for below in range(row + 1, n):
            under = below * columns - base
            dot = 0.0
            for k in range(base + row, base + end):
                dot += work[k] * work[under + k]
            dot *= over
            for k in range(base + row, base + end):
                work[under + k] -= dot * work[k]
            root[below, row] = -side * work[under + base + row]


@inline
def innovate(
    mean: Vector,
    root: Matrix,
    picks: NDArray[np.int64],
    count: int,
    measured: Vector,
    noise_std: Vector,
    innovation: Vector,
    innovation_root: Matrix,
    work: Vector,
) -> float:
    """Innovation of measured states, the root of its covariance, and its NIS (chi square).

    Args:
        mean: predicted, (n).
        root: predicted, (n, n).
        picks: indices of the measured states, increasing.
        count: how many of them there are, 1 at least.
        measured: by state index.
        noise_std: of the measurement, by state index.
        innovation: result, by order in `picks`.
        innovation_root: result, the lower triangle of its first `count` rows.
        work: scratch, (count (n + count)).
    """
    dense = picks[count - 1] + 1  # S is lower triangular: columns right of it are zero
    columns = dense + count
    for row in range(count):
        state = picks[row]
        for k in range(columns):
            work[row * columns + k] = root[state, k] if k < dense else 0.0
        work[row * columns + dense + row] = noise_std[state]
        innovation[row] = measured[state] - mean[state]
    triangularise(work, count, columns, dense, 0, innovation_root)
    return _chi_square(innovation, innovation_root, count, work)


@inline
def _chi_square(innovation: Vector, innovation_root: Matrix, count: int, work: Vector) -> float:
    """Return the innovation squared over its covariance, by one forward substitution."""
    total = 0.0
    for row in range(count):
        whitened = innovation[row]
        for k in range(row):
            whitened -= innovation_root[row, k] * work[k]
        whitened /= innovation_root[row, row]
        work[row] = whitened
        total += whitened * whitened
    return total


@inline
def correct(
    mean: Vector,
    root: Matrix,
    n: int,
    picks: NDArray[np.int64],
    count: int,
    noise_std: Vector,
    innovation: Vector,
    innovation_root: Matrix,
    gain: Matrix,
    work: Vector,
) -> None:
    """Measurement update by measured states after `innovate`, in place.

    K = (P_xy / S_y') / S_y with P_xy = S_x S_x[picks]', and S+ from [S - K S[picks], K sqrt(R)],
    which is P - K P_yy K' without a difference. Only the columns up to the last measured state
    change; the rest stays triangular, so few columns are eliminated.

    Args:
        mean: predicted, then corrected, (n).
        root: predicted, then corrected, (n, n).
        n: number of states.
        picks: as given to `innovate`.
        count: as given to `innovate`.
        noise_std: of the measurement, by state index.
        innovation: of `innovate`.
        innovation_root: of `innovate`.
        gain: result K by order in `picks`, (n, count) at least.
        work: scratch, (n (n + count)).
    """
    dense = picks[count - 1] + 1
    columns = n + count
    for row in range(n):
        for j in range(count):
            gain[row, j] = 0.0
            for k in range(min(row + 1, dense)):
                gain[row, j] += root[row, k] * root[picks[j], k]
        mean[row] += _gain_from_cross(gain, row, innovation_root, innovation, count)
    for row in range(n):
        base = row * columns
        for k in range(dense):
            entry = root[row, k]
            for j in range(count):
                entry -= gain[row, j] * root[picks[j], k]
            work[base + k] = entry
        for j in range(count):
            work[base + dense + j] = gain[row, j] * noise_std[picks[j]]
        for k in range(dense, n):
            work[base + count + k] = root[row, k]
    triangularise(work, n, columns, dense + count, dense, root)


@inline
def _gain_from_cross(
    gain: Matrix, row: int, innovation_root: Matrix, innovation: Vector, count: int
) -> float:
    """K = (P_xy / S_y') / S_y in place for one state; return the correction of that state."""
    for j in range(count):
        for k in range(j):
            gain[row, j] -= gain[row, k] * innovation_root[j, k]
        gain[row, j] /= innovation_root[j, j]
    shift = 0.0
    for j in range(count - 1, -1, -1):
        for k in range(j + 1, count):
            gain[row, j] -= gain[row, k] * innovation_root[k, j]
        gain[row, j] /= innovation_root[j, j]
        shift += gain[row, j] * innovation[j]
    return shift
