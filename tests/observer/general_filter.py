"""Appendix A for any model and any measurement, made of the observer's own pieces in `cdkf.py`."""

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from observer.filter.cdkf import (
    SIGMA_4,
    Matrix,
    Vector,
    _chi_square,
    _gain_from_cross,
    compress,
    spread,
    triangularise,
)
from observer.jit import inline

# --- the filter ---------------------------------------------------------------------------------


def time_update(model: Callable[[Vector, Vector, float], Vector]) -> Callable[..., None]:
    """A compiled `predict(mean, root, inputs, dt_s, noise_std, step)` around a model, in place.

    Args:
        model: compiled `(state, inputs, dt_s) -> next state`, any number of states and inputs.

    Not cached on disk: numba cannot, for functions that hold functions.
    """

    def predict(
        mean: Vector, root: Matrix, inputs: Vector, dt_s: float, noise_std: Vector, step: float
    ) -> None:
        n = mean.size
        lanes = 2 * n + 1
        points = np.empty(n * lanes)
        spread(mean, root, step, n, lanes, points)
        for lane in range(lanes):
            points[lane::lanes] = model(points[lane::lanes].copy(), inputs, dt_s)
        compress(points, np.diag(noise_std), step, n, lanes, mean, root, np.empty(3 * n * n))

    return _compiled(predict)


def measurement_update(observe: Callable[[Vector, Vector], Vector]) -> Callable[..., float]:
    """A compiled `update(mean, root, inputs, measured, noise_std, step) -> nis`, in place.

    Args:
        observe: compiled `(state, inputs) -> expected measurement`.

    Not cached on disk, like `time_update`.
    """

    def update(
        mean: Vector,
        root: Matrix,
        inputs: Vector,
        measured: Vector,
        noise_std: Vector,
        step: float,
    ) -> float:
        n, m = mean.size, measured.size
        lanes = 2 * n + 1
        points = np.empty(n * lanes)
        spread(mean, root, step, n, lanes, points)
        seen = np.empty((m, lanes))
        for lane in range(lanes):
            seen[:, lane] = observe(points[lane::lanes].copy(), inputs)
        return correct_by_points(mean, root, seen, measured, noise_std, step)

    return _compiled(update)


@inline
def correct_by_points(
    mean: Vector, root: Matrix, seen: Matrix, measured: Vector, noise_std: Vector, step: float
) -> float:
    """Update in place from the measurements at the sigma points of (mean, root); return the NIS.

    Args:
        mean: predicted, then corrected, (n).
        root: predicted, then corrected, (n, n).
        seen: the points after the measurement function, (m, 2 n + 1).
        measured: (m).
        noise_std: of the measurement, (m).
        step: h, as the points were drawn.
    """
    n, m = mean.size, measured.size
    columns = 2 * n + m
    wide = np.zeros((m, columns))  # [S_y1, S_y2, sqrt(R)], copied before it is factorised
    innovation, innovation_root, gain = np.zeros(m), np.zeros((m, m)), np.zeros((n, m))
    for j in range(m):
        innovation[j] = measured[j] - seen[j, 0]
        for i in range(n):
            plus = seen[j, 1 + i] - seen[j, 0]
            minus = seen[j, 1 + n + i] - seen[j, 0]
            wide[j, i] = 0.5 / step * (plus - minus)
            wide[j, n + i] = math.sqrt(SIGMA_4 - 1.0) * 0.5 / (step * step) * (plus + minus)
            innovation[j] -= 0.5 / (step * step) * (plus + minus)
        wide[j, 2 * n + j] = noise_std[j]
    triangularise(wide.copy().ravel(), m, columns, columns, 0, innovation_root)
    work = np.zeros(n * columns)
    for row in range(n):
        for j in range(m):
            for k in range(n):
                gain[row, j] += root[row, k] * wide[j, k]
        mean[row] += _gain_from_cross(gain, row, innovation_root, innovation, m)
        # S - K S_y1, K S_y2, K sqrt(R): the sign of the last two does not matter.
        for k in range(columns):
            work[row * columns + k] = root[row, k] if k < n else 0.0
            for j in range(m):
                work[row * columns + k] -= gain[row, j] * wide[j, k]
    triangularise(work, n, columns, columns, 0, root)
    return _chi_square(innovation, innovation_root, m, work)


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    return numba.njit(error_model="numpy")(function)
