"""The observer over recorded columns: the live `advance` in one compiled loop, with the same bits.

One row is one cycle. The filter starts at the first complete row; the time step of a row is its
distance from the previous row in whole nanoseconds, as the service measures it, so gaps and jitter
of a recording have the same effect as live.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.filter.considered import take_off
from observer.filter.leg_filter import (
    OUT_COVARIANCE,
    OUT_INNOVATION,
    OUT_NET,
    OUT_NET_STD,
    OUT_NIS,
    OUT_PASSIVE,
    OUT_SIZE,
    OUT_STD,
    advance,
)
from observer.filter.leg_memory import LegMemory, new_memory
from observer.filter.leg_model import STEP_S
from observer.filter.leg_observer import Setup, begin_at
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
    first_step_s: float | None = None
    """Measured step of the first row, which is then processed as the service does: the filter is at
    rest at its pose before. None, or no possible pose: it starts with the first complete row."""


@dataclass(frozen=True, slots=True, eq=False)
class BatchEstimates:
    """What is published of each of n rows; NaN before the first pose."""

    state: Matrix
    """Shape (n, 8), in the order and units of `states.STATE_NAMES`; of friction and patient what
    the baseline does not explain."""
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
    unsure: Matrix
    """Shape (n, 2 VARIANTS_MAX): error of the patient's effort by each considered parameter, hip
    then slide; (n, 0) where it was not kept: of the filter, without smoother."""


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
    rows = prepared(columns)
    count = len(rows.steps_s)
    memory, points = begun_memory(setup, columns)
    for begin in range(0, count, BLOCK_ROWS):
        end = min(begin + BLOCK_ROWS, count)
        run_rows(setup, rows, begin, end, memory, points)
        if progress is not None:
            progress(end / count)
    return rows.estimates()


def begun_memory(setup: Setup, columns: Columns) -> tuple[Sequence[LegMemory], Vector]:
    """Return the filter's memory and points before the first row."""
    memory, points = new_memory()
    if columns.first_step_s is not None and np.isfinite(columns.position[0]).all():
        begin_at(setup, memory, *columns.position[0].tolist())
    return memory, points


class Rows(NamedTuple):
    """Inputs and results of n rows as the kernels take them."""

    steps_s: Vector
    position: Matrix
    effort: Matrix
    bits: Integers
    numbers: Matrix
    """Shape (n, OUT_SIZE): the results of `advance`, without what the baseline explains."""
    flags: Integers
    """Shape (n, 3): status, validity of hip and slide."""

    def estimates(self) -> BatchEstimates:
        """Name the results."""
        return BatchEstimates(
            state=self.numbers[:, :OUT_STD],
            std=self.numbers[:, OUT_STD:OUT_COVARIANCE],
            covariance=self.numbers[:, OUT_COVARIANCE:OUT_INNOVATION],
            innovation=self.numbers[:, OUT_INNOVATION:OUT_NIS],
            nis=self.numbers[:, OUT_NIS],
            net=self.numbers[:, OUT_NET:OUT_NET_STD],
            net_std=self.numbers[:, OUT_NET_STD:OUT_PASSIVE],
            status=self.flags[:, 0],
            validity=self.flags[:, 1:],
            unsure=self.numbers[:, OUT_SIZE:],
        )


def prepared(columns: Columns) -> Rows:
    """Time steps and inputs of a recording, and room for its results.

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
        steps_s = np.rint(np.diff(time_s, prepend=time_s[:1]) * 1e9) * 1e-9
    steps_s[:1] = STEP_S if columns.first_step_s is None else columns.first_step_s
    return Rows(
        steps_s,
        np.ascontiguousarray(columns.position, dtype=np.float64),
        np.ascontiguousarray(columns.effort, dtype=np.float64),
        np.ascontiguousarray(bits, dtype=np.int64),
        np.empty((count, OUT_SIZE)),
        np.empty((count, 3), dtype=np.int64),
    )


@kernel
def run_rows(
    setup: Setup, rows: Rows, begin: int, end: int, memory: Sequence[LegMemory], points: Vector
) -> None:
    """Run the cycles of some rows, and write their results to them."""
    for row in range(begin, end):
        numbers = rows.numbers[row]
        status, level_hip, level_slide = advance(
            setup,
            memory,
            points,
            (rows.position[row, 0], rows.position[row, 1]),
            (rows.effort[row, 0], rows.effort[row, 1]),
            (0.0, 0.0),
            rows.steps_s[row],
            rows.bits[row],
            numbers,
        )
        if setup[0].baseline_taken != 0.0:
            take_off(numbers[OUT_PASSIVE:], OUT_NET, numbers)
        rows.flags[row, 0] = status
        rows.flags[row, 1] = level_hip
        rows.flags[row, 2] = level_slide
