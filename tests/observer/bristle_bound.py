"""What can be reached on bristles: a CDKF that knows the plant's own, in steps of a millisecond."""

import math

import numpy as np

from observer.filter.cdkf import STEP, compress, correct, innovate, spread
from observer.jit import kernel
from observer.mechanism.linkage import bounded_acceleration
from tests.observer.trainer import HIP_BRISTLES, PATIENT, SLIDE_BRISTLES, TUNING, bristle_step

PARTS = 10
START_STD = (1e-3, 1e-3, 1e-2, 1e-2, 1e-3, 3e-4, 1.0, 10.0)
DEFLECTION_STD = (2.5e-5, 5e-6)
BOTH = np.array([0, 1])


@kernel
def _step(state, effort, dt_s):
    """Positions, velocities, deflections of the bristles, patient."""
    x = state.copy()
    part_s = dt_s / PARTS
    for _ in range(PARTS):
        z1, f1 = bristle_step(HIP_BRISTLES, x[4], x[2], part_s)
        z2, f2 = bristle_step(SLIDE_BRISTLES, x[5], x[3], part_s)
        a1, a2, _ = bounded_acceleration(
            PATIENT, x[0], x[1], x[2], x[3], effort[0] + x[6] - f1, effort[1] + x[7] - f2, 1.0
        )
        x[4], x[5] = z1, z2
        x[2] += part_s * a1
        x[3] += part_s * a2
        x[0] += part_s * x[2]
        x[1] += part_s * x[3]
    return x


@kernel
def _predict(mean, root, effort, dt_s, noise_std):
    """`general_filter.time_update` of this model, in a form that numba keeps on disk."""
    n = mean.size
    lanes = 2 * n + 1
    points = np.empty(n * lanes)
    spread(mean, root, STEP, n, lanes, points)
    for lane in range(lanes):
        points[lane::lanes] = _step(points[lane::lanes].copy(), effort, dt_s)
    compress(points, np.diag(noise_std), STEP, n, lanes, mean, root, np.empty(3 * n * n))


def patient_of(columns, patient_std) -> np.ndarray:
    """Estimated effort of the patient, (n, 2).

    Args:
        columns: a recording of PATIENT with the trainer's bristles, without gaps.
        patient_std: process noise of the patient's efforts per step, hip and slide.
    """
    noise = np.array([*TUNING.process_std[:4], *DEFLECTION_STD, *patient_std])
    seen_std = np.array(TUNING.measurement_std)
    mean, root = np.zeros(8), np.diag(START_STD)
    mean[:2] = columns.position[0]
    innovation, innovation_root = np.zeros(2), np.zeros((2, 2))
    gain, work = np.zeros((8, 2)), np.zeros(3 * 64)
    made = np.zeros((len(columns.time_s), 2))
    for row, dt_s in enumerate(np.diff(columns.time_s), start=1):
        _predict(mean, root, columns.effort[row], dt_s, noise)
        measured = columns.position[row].copy()
        innovate(mean, root, BOTH, 2, measured, seen_std, innovation, innovation_root, work)
        correct(mean, root, 8, BOTH, 2, seen_std, innovation, innovation_root, gain, work)
        made[row] = mean[6:]
    assert math.isfinite(mean.sum())
    return made
