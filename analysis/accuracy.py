"""Accuracy of an estimate: samples matched with the truth by time, then summary figures."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.mechanism.friction import STANDSTILL_GATE, FrictionParameters, gate_of

Times = NDArray[np.int64]
Values = NDArray[np.float64]


class Score(NamedTuple):
    """An estimate against the truth, over the samples where the estimate was valid."""

    sample_count: int
    covered_ratio: float
    """Share of the samples with a valid estimate."""
    rms: float
    """Root mean square of estimate minus truth; NaN without samples."""
    worst: float
    """Largest absolute difference; NaN without samples."""
    bias: float
    """Mean of estimate minus truth; NaN without samples."""
    correlation: float
    """Pearson's; NaN where the truth (or the estimate) does not vary."""


def nearest(wanted_ns: Times, offered_ns: Times, tolerance_ns: int) -> NDArray[np.intp]:
    """Find the index of the nearest offered time for each wanted one, -1 where none is near enough.

    Args:
        wanted_ns: shape (n,), any order.
        offered_ns: shape (m,), increasing.
        tolerance_ns: largest distance that still matches.
    """
    if len(offered_ns) == 0:
        return np.full(len(wanted_ns), -1, dtype=np.intp)
    right = np.clip(np.searchsorted(offered_ns, wanted_ns), 0, len(offered_ns) - 1)
    left = np.clip(right - 1, 0, len(offered_ns) - 1)
    nearer_left = np.abs(wanted_ns - offered_ns[left]) <= np.abs(offered_ns[right] - wanted_ns)
    index = np.where(nearer_left, left, right)
    far = np.abs(offered_ns[index] - wanted_ns) > tolerance_ns
    return np.where(far, -1, index).astype(np.intp)


def score(estimate: Values, truth: Values) -> Score:
    """Compare an estimate with the truth; NaN in either is a missing sample.

    Args:
        estimate: shape (n,), in the truth's unit.
        truth: shape (n,), at the same instants.
    """
    both = np.isfinite(estimate) & np.isfinite(truth)
    count = int(np.count_nonzero(both))
    covered = count / len(estimate) if len(estimate) else 0.0
    if count == 0:
        return Score(0, covered, math.nan, math.nan, math.nan, math.nan)
    known, true = estimate[both], truth[both]
    error = known - true
    return Score(
        sample_count=count,
        covered_ratio=covered,
        rms=float(np.sqrt(np.mean(error**2))),
        worst=float(np.max(np.abs(error))),
        bias=float(np.mean(error)),
        correlation=_correlation(known, true),
    )


def moving(
    velocity: Values, frictions: tuple[FrictionParameters, FrictionParameters]
) -> NDArray[np.bool_]:
    """Mark where the true speed, shape (n, 2), opens the gate a(v), eq. (12), to a half or more."""
    return np.column_stack(
        [
            [gate_of(friction, speed) >= STANDSTILL_GATE for speed in speeds.tolist()]
            for friction, speeds in zip(frictions, velocity.T, strict=True)
        ]
    )


def _correlation(a: Values, b: Values) -> float:
    if np.std(a) == 0 or np.std(b) == 0:
        return math.nan
    return float(np.corrcoef(a, b)[0, 1])
