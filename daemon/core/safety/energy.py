"""Sums over the last stride: net energy that a drive put into the leg, and effort left unexplained.

Energy is the drive's measured effort times the step of the encoder: what friction takes is in it,
what the patient puts in is not. Where no gait says how long a stride is, a window of limits.toml
stands in for it.
"""

from collections import deque

STRIDE_MAX_CYCLES = 1000
"""A slower stride than this counts over its last ten seconds."""


class StrideSum:
    """A sum over the newest cycles, at most STRIDE_MAX_CYCLES of them."""

    def __init__(self) -> None:
        # Running totals: the difference of two is the sum between them.
        self._totals = deque([0.0], STRIDE_MAX_CYCLES + 1)

    def take(self, value: float) -> None:
        """One cycle more."""
        self._totals.append(self._totals[-1] + value)

    def clear(self) -> None:
        """Begin anew."""
        self._totals.clear()
        self._totals.append(0.0)

    def over(self, cycles: int) -> float | None:
        """The sum over so many cycles; None while there are fewer."""
        if cycles >= len(self._totals):
            return None
        return self._totals[-1] - self._totals[-1 - cycles]

    def so_far(self, cycles: int) -> float:
        """The sum over so many cycles, or over all there are."""
        return self._totals[-1] - self._totals[max(len(self._totals) - 1 - cycles, 0)]


def stride_cycles(cadence_hz: float, period_s: float) -> int:
    """Cycles of one stride at a cadence, at most STRIDE_MAX_CYCLES."""
    return min(max(round(1.0 / (cadence_hz * period_s)), 1), STRIDE_MAX_CYCLES)
