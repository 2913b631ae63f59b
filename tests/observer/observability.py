"""Observability of the eight states from two encoders: the rank of the observability matrix.

The model is linearised at a state (central differences of one step of the filter's own RK4 map).
C, C A, C A^2, ... of eight steps are stacked, in units in which all states are of order one. The
rank is 6 with both axes at rest, 7 with one in motion and 8 with both: at rest friction_i and
patient_i enter only as their difference (observer.md, fact 4; null vector friction_i + patient_i).

No singular value is computed at run time: an axis' split is observable when its gate a(v) is open,
which the status bits STANDSTILL_HIP and STANDSTILL_SLIDE show; a test compares the two.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.filter.leg_model import LANES, STEP_S, LegModel, runge_kutta
from observer.filter.states import FRICTION, PATIENT, POSITION, STATE_COUNT, VELOCITY
from observer.jit import kernel
from observer.mechanism.mechanism import mass_matrix
from tests.observer.mechanics import acceleration

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

SCALE: Final = np.array((1e-4, 5e-5, 1e-2, 5e-3, 1.0, 10.0, 1.0, 10.0))
"""Scale of each state, in its own unit."""
DIFFERENCE: Final = 1e-2
"""Half width of the differences, in units of SCALE."""
STEPS: Final = 8
SUBSTEPS: Final = 2
RANK_TOLERANCE: Final = 1e-4
"""Relative to the largest singular value."""


def rank(model: LegModel, state: Vector) -> int:
    """Numerical rank of the observability matrix, linearised at a state in balance.

    Args:
        model: of the filter.
        state: shape (8,). The drives are assumed to hold it: velocities stay constant.
    """
    values = singular_values(model, state)
    return int(np.count_nonzero(values > RANK_TOLERANCE * values[0]))


def singular_values(model: LegModel, state: Vector) -> Vector:
    """Singular values of the observability matrix in SCALE; largest first, shape (8,)."""
    transition = jacobian(model, state)
    block = np.zeros((2, STATE_COUNT))
    block[0, 0] = block[1, 1] = 1.0
    rows = [block]
    for _ in range(STEPS - 1):
        block = block @ transition
        rows.append(block)
    scaled = np.vstack(rows) * SCALE / SCALE[[0, 1] * STEPS][:, None]
    return np.asarray(np.linalg.svd(scaled, compute_uv=False), dtype=np.float64)


def null_vectors(model: LegModel, state: Vector) -> Matrix:
    """Unobservable directions in SCALE, one in each row."""
    transition = jacobian(model, state)
    block = np.eye(2, STATE_COUNT)
    rows = [block := block @ transition for _ in range(STEPS)]
    scaled = np.vstack([np.eye(2, STATE_COUNT), *rows]) * SCALE
    scaled /= np.tile(SCALE[:2], STEPS + 1)[:, None]
    _, values, vectors = np.linalg.svd(scaled)
    return vectors[values <= RANK_TOLERANCE * values[0]]


def jacobian(model: LegModel, state: Vector) -> Matrix:
    """Derivative of the next state by the state, one step of STEP_S, shape (8, 8)."""
    effort = holding_effort(model, state)
    columns = [
        (_after(model, effort, state + change) - _after(model, effort, state - change))
        / (2.0 * change[index])
        for index, change in enumerate(np.diag(DIFFERENCE * SCALE))
    ]
    return np.column_stack(columns)


def holding_effort(model: LegModel, state: Vector) -> Vector:
    """Torque and force of the drives without acceleration of any axis, shape (2,): N m, N."""
    load = state[FRICTION] - state[PATIENT]
    full = bool(model.coriolis_share)
    pose = state[POSITION]
    unheld = acceleration(model.leg, pose, state[VELOCITY], np.zeros(2), load, full)
    return np.asarray(-mass_matrix(model.leg, pose) @ unheld, dtype=np.float64)


def _after(model: LegModel, effort: Vector, state: Vector) -> Vector:
    points = np.repeat(state, LANES)
    _advance(model, effort[0], effort[1], points)
    return points[::LANES].copy()


@kernel
def _advance(model: LegModel, effort_hip: float, effort_slide: float, points: Vector) -> None:
    for _ in range(SUBSTEPS):
        runge_kutta(model, effort_hip, effort_slide, STEP_S / SUBSTEPS, points)
