"""The passive baseline: the estimated patient effort, by gait phase, of a passive patient.

Leg mass, springs and friction never match their configuration exactly. The resulting error repeats
with the stride, so it is recorded once with a passive patient, and subtracted from then on.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.offline.batch import BatchEstimates, Columns
from observer.strides import (
    BASELINE_BINS,
    DT,
    KNOWN,
    PATIENT,
    StrideCounter,
    samples_of,
)

Matrix = NDArray[np.float64]

STRIDES_MIN: Final = 5
SAMPLES_MIN: Final = 3
"""Samples in each bin."""


class Baseline(NamedTuple):
    """Baseline by gait phase in BASELINE_BINS bins, from one rise of the hip to the next."""

    mean: Matrix
    """Shape (BASELINE_BINS, 2): N m, N; NaN in a bin without samples."""
    std: Matrix
    """Standard deviation of the samples about the mean, same shape."""
    sample_count: NDArray[np.int64]
    """Number of samples, same shape."""
    stride_count: int
    cadence_hz: float
    """Mean over the strides."""


class TooFewError(ValueError):
    """The recording is not sufficient for a baseline; the message names what is missing."""


def baseline_of(smooth: BatchEstimates, columns: Columns) -> Baseline:
    """Compute the baseline of a smoothed passive recording.

    Bins in which the split was never observable, at a reversal, are interpolated from their
    neighbours.

    Raises:
        TooFewError: too few strides, or an axis with too few valid samples.
    """
    counter = StrideCounter()
    sums, squares = np.zeros((BASELINE_BINS, 2)), np.zeros((BASELINE_BINS, 2))
    counts = np.zeros((BASELINE_BINS, 2), dtype=np.int64)
    durations_s: list[float] = []
    for sample in samples_of(smooth, columns):
        stride = counter.add(sample)
        if stride is None:
            continue
        durations_s.append(stride.duration_s)
        _add(counter.completed, sums, squares, counts)
    if len(durations_s) < STRIDES_MIN:
        raise TooFewError(
            f"has {len(durations_s)} strides; a baseline needs at least {STRIDES_MIN}"
        )
    for axis, name in enumerate(("hip", "slide")):
        known = int(np.count_nonzero(counts[:, axis] >= SAMPLES_MIN))
        if known < BASELINE_BINS // 2:
            raise TooFewError(
                f"the {name}'s patient is known in {known} of {BASELINE_BINS} parts of the stride; "
                "at least half are needed: use a higher cadence or amplitude"
            )
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = sums / counts
        std = np.sqrt(np.maximum(squares / counts - mean * mean, 0.0))
    for axis in range(2):
        _bridge(mean[:, axis], counts[:, axis] >= SAMPLES_MIN)
        _bridge(std[:, axis], counts[:, axis] >= SAMPLES_MIN)
    return Baseline(mean, std, counts, len(durations_s), len(durations_s) / sum(durations_s))


def _add(rows: Matrix, sums: Matrix, squares: Matrix, counts: NDArray[np.int64]) -> None:
    ends_s = np.cumsum(rows[:, DT])
    bins = ((ends_s - 0.5 * rows[:, DT]) / ends_s[-1] * BASELINE_BINS).astype(np.intp)
    for axis in range(2):
        known = rows[:, KNOWN + axis] > 0.0
        patient = rows[known, PATIENT + axis]
        np.add.at(sums[:, axis], bins[known], patient)
        np.add.at(squares[:, axis], bins[known], patient * patient)
        np.add.at(counts[:, axis], bins[known], 1)


def _bridge(values: NDArray[np.float64], known: NDArray[np.bool_]) -> None:
    """Interpolate unknown bins from their neighbours, cyclically."""
    places = np.arange(BASELINE_BINS)
    values[~known] = np.interp(
        places[~known], places[known], values[known], period=float(BASELINE_BINS)
    )
