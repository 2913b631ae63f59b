"""The observer over recorded columns: the live `advance` in one compiled loop, with the same bits.

One row is one cycle. The filter starts at the first complete row; the time step of a row is its
distance from the previous row, so gaps and jitter of a recording have the same effect as live.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.filter.leg_filter import (
    OUT_COVARIANCE,
    OUT_INNOVATION,
    OUT_NET,
    OUT_NET_STD,
    OUT_NIS,
    OUT_SIZE,
    OUT_STD,
    advance,
)
from observer.filter.leg_memory import LegMemory, new_memory
from observer.filter.leg_model import STEP_S
from observer.filter.leg_observer import Setup
from observer.jit import kernel

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Integers = NDArray[np.int64]

BLOCK_ROWS: Final = 20_000
"""Rows between two progress reports: a fifth of a second."""


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """A recording of n rows, in order of time."""

    time_s: Vector
    """Shape (n,)."""
    position: Matrix
    """Shape (n, 2): hip angle rad, slide position m, sampled at the row's time; NaN if missing."""
    effort: Matrix
    """Shape (n, 2): hip torque N m, slide force N that acted from the previous row to this one."""
    caller_bits: Integers | None = None
    """Shape (n,): Status bits known to the caller; none if None."""


@dataclass(frozen=True, slots=True, eq=False)
class BatchEstimates:
    """Results of `LegObserver.step` at each of n rows; NaN before the first pose."""

    state: Matrix
    """Shape (n, 8), in the order and units of `states.STATE_NAMES`."""
    std: Matrix
    """Shape (n, 8)."""
    covariance: Matrix
    """Shape (n, 36): lower triangles, row by row."""
    innovation: Matrix
    """Shape (n, 2): rad, m; NaN where not measured."""
    nis: Vector
    """Shape (n,): NaN where not measured."""
    net: Matrix
    """Shape (n, 2): patient minus friction, N m, N."""
    net_std: Matrix
    """Shape (n, 2)."""
    status: Integers
    """Shape (n,): bits of status.Status."""
    validity: Integers
    """Shape (n, 2): status.Validity of hip and slide."""


def run(
    setup: Setup, columns: Columns, progress: Callable[[float], None] | None = None
) -> BatchEstimates:
    """Run the observer over a whole recording.

    Args:
        setup: from `leg_observer.setup_of`, or an observer's `setup`.
        columns: the recording.
        progress: called now and then with the share done; changes no bit of the result.

    Raises:
        ValueError: columns of different lengths.
    """
    steps_s, position, effort, bits = prepared(columns)
    count = len(steps_s)
    numbers = np.empty((count, OUT_SIZE))
    flags = np.empty((count, 3), dtype=np.int64)
    memory, points = new_memory()
    for begin in range(0, count, BLOCK_ROWS):
        block = slice(begin, begin + BLOCK_ROWS)
        _run(
            *setup,
            steps_s[block],
            position[block],
            effort[block],
            bits[block],
            memory,
            points,
            numbers[block],
            flags[block],
        )
        if progress is not None:
            progress(min((begin + BLOCK_ROWS) / count, 1.0))
    return split_up(numbers, flags)


def prepared(columns: Columns) -> tuple[Vector, Matrix, Matrix, Integers]:
    """Time steps, positions, efforts and bits as the kernels take them.

    Raises:
        ValueError: columns of different lengths.
    """
    count = len(columns.time_s)
    bits = np.zeros(count) if columns.caller_bits is None else columns.caller_bits
    for name, shape, wanted in (
        ("position", columns.position.shape, (count, 2)),
        ("effort", columns.effort.shape, (count, 2)),
        ("caller_bits", bits.shape, (count,)),
    ):
        if shape != wanted:
            raise ValueError(f"{name} has the shape {shape}, the times need {wanted}")
    time_s = np.asarray(columns.time_s, dtype=np.float64)
    # Infinite times have no step between them; the kernels treat that as a gap.
    with np.errstate(over="ignore", invalid="ignore"):
        steps_s = np.diff(time_s, prepend=time_s[:1])
    steps_s[:1] = STEP_S
    return (
        steps_s,
        np.ascontiguousarray(columns.position, dtype=np.float64),
        np.ascontiguousarray(columns.effort, dtype=np.float64),
        np.ascontiguousarray(bits, dtype=np.int64),
    )


def split_up(numbers: Matrix, flags: Integers) -> BatchEstimates:
    """Name the outputs of `advance`: numbers (n, OUT_SIZE), and status and validity (n, 3)."""
    return BatchEstimates(
        state=numbers[:, :OUT_STD],
        std=numbers[:, OUT_STD:OUT_COVARIANCE],
        covariance=numbers[:, OUT_COVARIANCE:OUT_INNOVATION],
        innovation=numbers[:, OUT_INNOVATION:OUT_NIS],
        nis=numbers[:, OUT_NIS],
        net=numbers[:, OUT_NET:OUT_NET_STD],
        net_std=numbers[:, OUT_NET_STD:],
        status=flags[:, 0],
        validity=flags[:, 1:],
    )


@kernel
def _run(
    leg: tuple[float, ...],
    hip: tuple[float, ...],
    slide: tuple[float, ...],
    coriolis_share: float,
    options: tuple[float, ...],
    process_std: Vector,
    measurement_std: Vector,
    steps_s: Vector,
    position: Matrix,
    effort: Matrix,
    bits: Integers,
    memory: Sequence[LegMemory],
    points: Vector,
    numbers: Matrix,
    flags: Integers,
) -> None:
    for row in range(steps_s.size):
        status, level_hip, level_slide = advance(
            leg,
            hip,
            slide,
            coriolis_share,
            options,
            process_std,
            measurement_std,
            memory,
            points,
            position[row, 0],
            position[row, 1],
            effort[row, 0],
            effort[row, 1],
            steps_s[row],
            bits[row],
            numbers[row],
        )
        flags[row, 0] = status
        flags[row, 1] = level_hip
        flags[row, 2] = level_slide
