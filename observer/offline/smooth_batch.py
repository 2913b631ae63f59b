"""The observer with its smoother over recorded columns: the live kernels, with the same bits.

Each estimate is at its own time: the smoothed one of a row is known LAG rows later. The last LAG
rows are smoothed with the rows that remain.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer.filter.leg_memory import LegMemory
from observer.filter.leg_observer import Setup
from observer.jit import kernel
from observer.offline.batch import (
    BatchEstimates,
    Columns,
    Rows,
    begun_memory,
    prepared,
    run_rows,
)
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
    SMOOTH_UNSURE,
    WORK_SIZE,
    smoothed,
    store,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

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
    rows = prepared(columns)
    count = len(rows.steps_s)
    smooth = np.full((count, SMOOTH_SIZE), np.nan)
    memory, points = begun_memory(setup, columns)
    ring, work = np.zeros(RING_SIZE), np.zeros(WORK_SIZE)
    for begin in range(0, count, BLOCK_ROWS):
        end = min(begin + BLOCK_ROWS, count)
        # As an argument LAG has the type that it has below, so `smoothed` is compiled once.
        _run(setup, rows, begin, end, LAG, memory, points, ring, work, smooth)
        if progress is not None:
            progress(end / count)
    for lag in range(min(LAG, count)):
        smoothed(setup, ring, lag, smooth[count - 1 - lag], work)
    return replace(
        rows.estimates(),
        state=smooth[:, :SMOOTH_STD],
        std=smooth[:, SMOOTH_STD:SMOOTH_COVARIANCE],
        covariance=smooth[:, SMOOTH_COVARIANCE:SMOOTH_NET],
        net=smooth[:, SMOOTH_NET:SMOOTH_NET_STD],
        net_std=smooth[:, SMOOTH_NET_STD:SMOOTH_CYCLE_DATA],
        unsure=smooth[:, SMOOTH_UNSURE:],
    )


@kernel
def _run(
    setup: Setup,
    rows: Rows,
    begin: int,
    end: int,
    lag: int,
    memory: Sequence[LegMemory],
    points: Vector,
    ring: Vector,
    work: Vector,
    smooth: Matrix,
) -> None:
    cycle_data = np.zeros(CYCLE_DATA_COUNT)
    for row in range(begin, end):
        run_rows(setup, rows, row, row + 1, memory, points)
        store(ring, memory, points, cycle_data, work)
        if row >= lag:
            smoothed(setup, ring, lag, smooth[row - lag], work)
