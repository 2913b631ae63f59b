"""Motion as numbers. Pure; arrays have one value for each cycle."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

LAGS: Final = range(4)
"""Cycles from a command to the sample that shows it, as drives differ."""
MOVES_RATIO: Final = 0.03
"""An axis rests below this share of the velocity that it had."""
REST_CYCLES: Final = 3

Values = NDArray[np.float64]


def response(commanded: Values, seen: Values) -> tuple[float, float]:
    """Slope and correlation of what is seen over what was commanded, at the lag that fits best.

    The means are taken off: friction that does not turn is a constant.

    Args:
        commanded: shape (n,).
        seen: shape (n,), same times.
    """
    best = 0.0, 0.0
    for lag in LAGS:
        cause = commanded[: len(commanded) - lag]
        effect = seen[lag:]
        cause, effect = cause - cause.mean(), effect - effect.mean()
        power = float(cause @ cause)
        size = float(np.sqrt(power * (effect @ effect)))
        if size > 0.0:
            correlation = float(cause @ effect) / size
            if abs(correlation) > abs(best[1]):
                best = float(cause @ effect) / power, correlation
    return best


def accelerations(position: Values, period_s: float) -> Values:
    """Second differences, shape (n,); those at both ends are 0."""
    made = np.zeros_like(position)
    made[1:-1] = np.diff(position, 2) / period_s**2
    return made


def rest_time_s(position: Sequence[float], period_s: float, velocity: float) -> float | None:
    """Time until the axis rests for REST_CYCLES; None if it does not.

    Args:
        position: at each cycle from the begin of the stop on.
        period_s: of a cycle.
        velocity: that it had, in units of the position per s.
    """
    still = np.abs(np.diff(np.asarray(position))) <= MOVES_RATIO * abs(velocity) * period_s
    for index in range(len(still) - REST_CYCLES + 1):
        if still[index : index + REST_CYCLES].all():
            return index * period_s
    return None
