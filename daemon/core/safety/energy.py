"""Sums over the last stride: net energy that a drive put into the leg, and effort residual.

Energy is the drive's measured effort times the step of the encoder: it includes friction losses,
but not the work of the patient. Without a gait, a window of limits.toml replaces the stride.
"""

from collections import deque
from typing import Final

from daemon.core.period import cycles

STRIDE_MAX_CYCLES: Final = cycles(10.0)
"""Longest window, ten seconds: of a slower stride only the last part counts."""


class StrideSum:
    """A sum over the newest cycles, at most STRIDE_MAX_CYCLES of them."""

    def __init__(self) -> None:
        # Running totals: the difference of two is the sum between them.
        self._totals = deque([0.0], STRIDE_MAX_CYCLES + 1)

    def add(self, value: float) -> None:
        """Add the value of one cycle."""
        self._totals.append(self._totals[-1] + value)

    def clear(self) -> None:
        """Remove all values."""
        self._totals.clear()
        self._totals.append(0.0)

    def over(self, cycles: int) -> float | None:
        """The sum over the newest `cycles`; None while there are fewer."""
        if cycles >= len(self._totals):
            return None
        return self._totals[-1] - self._totals[-1 - cycles]

    def so_far(self, cycles: int) -> float:
        """The sum over the newest `cycles`, or over all if there are fewer."""
        return self._totals[-1] - self._totals[max(len(self._totals) - 1 - cycles, 0)]


def stride_cycles(cadence_hz: float, period_s: float) -> int:
    """Cycles of one stride at a cadence, at most STRIDE_MAX_CYCLES."""
    return min(max(round(1.0 / (cadence_hz * period_s)), 1), STRIDE_MAX_CYCLES)
