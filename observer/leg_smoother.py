"""Live smoother of one leg: each cycle returns the smoothed cycle of 150 ms ago."""

from collections.abc import Sequence

import numpy as np

from observer.filter.leg_observer import LegEstimate, LegObserver
from observer.smoother import (
    CYCLE_DATA_COUNT,
    LAG,
    RING_SIZE,
    SMOOTH_SIZE,
    WORK_SIZE,
    smoothed,
    store,
)
from observer.strides import cycle_data_of


class LegSmoother:
    """Smooths the estimates of one `LegObserver`, cycle by cycle."""

    def __init__(self, observer: LegObserver) -> None:
        """Start without any samples."""
        self._observer = observer
        self._ring = np.zeros(RING_SIZE)
        self._work = np.zeros(WORK_SIZE)
        self._cycle_data = np.zeros(CYCLE_DATA_COUNT)
        self._out = np.zeros(SMOOTH_SIZE)

    def add(
        self, estimate: LegEstimate, effort: Sequence[float], dt_s: float
    ) -> list[float] | None:
        """Add one cycle; return the smoothed estimate LAG cycles ago, None before there is one.

        Args:
            estimate: of the cycle that the observer has just finished.
            effort: the observer's input, N m and N.
            dt_s: since the previous cycle.

        Returns:
            Places as in `smoother.py` (SMOOTH_SIZE), notes as in `strides.py`.
        """
        self._cycle_data[:] = cycle_data_of(dt_s, effort, estimate.status, estimate.validity)
        store(self._ring, *self._observer.buffers, self._cycle_data, self._work)
        if not smoothed(self._observer.setup, self._ring, LAG, self._out, self._work):
            return None
        return self._out.tolist()
