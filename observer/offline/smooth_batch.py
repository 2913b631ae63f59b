"""The observer with its smoother over recorded columns: the live kernels, with the same bits.

Each estimate is at its own time: the smoothed one of a row is known LAG rows later. The last LAG
rows are smoothed with the rows that remain.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer.filter.leg_filter import OUT_SIZE, advance
from observer.filter.leg_memory import LegMemory, new_memory
from observer.filter.leg_observer import Setup
from observer.jit import kernel
from observer.offline.batch import BatchEstimates, Columns, prepared, split_up
from observer.smoother import (
    CYCLE_DATA_COUNT,
    LAG,
    RING_SIZE,
    SMOOTH_COVARIANCE,
    SMOOTH_CYCLE_DATA,
    SMOOTH_NET,
    SMOOTH_NET_STD,
    SMOOTH_SIZE,
    SMOOTH_STD,
    WORK_SIZE,
    smoothed,
    store,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Integers = NDArray[np.int64]

BLOCK_ROWS = 10_000


def run_smoothed(
    setup: Setup, columns: Columns, progress: Callable[[float], None] | None = None
) -> BatchEstimates:
    """Smoothed state, std, covariance and net of a whole recording.

    Innovation, NIS, status and validity are those of the filter at the same row.

    Args:
        setup: from `leg_observer.setup_of`, or an observer's `setup`.
        columns: the recording.
        progress: called now and then with the share done; changes no bit of the result.

    Raises:
        ValueError: columns of different lengths.
    """
    steps_s, position, effort, bits = prepared(columns)
    count = len(steps_s)
    numbers, flags = np.empty((count, OUT_SIZE)), np.empty((count, 3), dtype=np.int64)
    smooth = np.full((count, SMOOTH_SIZE), np.nan)
    memory, points = new_memory()
    ring, work = np.zeros(RING_SIZE), np.zeros(WORK_SIZE)
    for begin in range(0, count, BLOCK_ROWS):
        block = slice(begin, begin + BLOCK_ROWS)
        given = (steps_s[block], position[block], effort[block], bits[block])
        state = (memory, points, ring, work)
        _run(*setup, *given, *state, numbers[block], flags[block], smooth, begin)
        if progress is not None:
            progress(min((begin + BLOCK_ROWS) / count, 1.0))
    for lag in range(min(LAG, count)):
        smoothed(ring, lag, smooth[count - 1 - lag], work)
    return replace(
        split_up(numbers, flags),
        state=smooth[:, :SMOOTH_STD],
        std=smooth[:, SMOOTH_STD:SMOOTH_COVARIANCE],
        covariance=smooth[:, SMOOTH_COVARIANCE:SMOOTH_NET],
        net=smooth[:, SMOOTH_NET:SMOOTH_NET_STD],
        net_std=smooth[:, SMOOTH_NET_STD:SMOOTH_CYCLE_DATA],
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
    ring: Vector,
    work: Vector,
    numbers: Matrix,
    flags: Integers,
    smooth: Matrix,
    begin: int,
) -> None:
    cycle_data = np.zeros(CYCLE_DATA_COUNT)
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
        store(ring, memory, points, cycle_data, work)
        if begin + row >= LAG:
            smoothed(ring, LAG, smooth[begin + row - LAG], work)
