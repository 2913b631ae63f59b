"""Motion as numbers. Pure; arrays have one value for each cycle."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

LAGS: Final = range(4)
"""Cycles from a command to the sample that shows it, as drives differ."""
MOVES_RATIO: Final = 0.03
"""An axis rests below this share of the velocity that it had."""
REST_CYCLES: Final = 3

Values = NDArray[np.float64]


def ratio(commanded: Values, seen: Values) -> float | None:
    """Slope of what is seen over what was commanded, at the lag that fits best.

    Args:
        commanded: shape (n,).
        seen: shape (n,), same times.
    """
    best: tuple[float, float] | None = None
    for lag in LAGS:
        cause, effect = commanded[: len(commanded) - lag], seen[lag:]
        power, size = float(cause @ cause), float(effect @ effect)
        if power and size:
            fit = float(cause @ effect)
            best = max(best or (-1.0, 0.0), (abs(fit) / np.sqrt(power * size), fit / power))
    return None if best is None else best[1]


def inverse_inertia(effort: Values, position: Values, period_s: float) -> tuple[float, float]:
    """1/J and partial correlation of the motion that a commanded effort explains.

    The motion is fitted as x = x0 + v t + (1/J) (effort, twice integrated) + (f/J) (sign of the
    velocity, twice integrated): friction of a constant size f is not taken for inertia. The
    position is fitted and not its second difference, which is mostly the encoder's step.

    Args:
        effort: shape (n,).
        position: shape (n,), same times.
        period_s: between two of them.
    """
    best = 0.0, 0.0
    time_s = np.arange(len(position)) * period_s
    turning = np.sign(np.gradient(position)) * (np.abs(np.gradient(position)) > 0)
    others = np.column_stack((np.ones_like(time_s), time_s, _twice(turning, period_s)))
    rest = position - _fitted(others, position)
    for lag in LAGS:
        late = np.concatenate((np.zeros(lag), effort[: len(effort) - lag]))
        cause = _twice(late, period_s)
        cause = cause - _fitted(others, cause)
        size = float(np.sqrt((cause @ cause) * (rest @ rest)))
        if size > 0.0:
            correlation = float(cause @ rest) / size
            if abs(correlation) > abs(best[1]):
                best = float(cause @ rest) / float(cause @ cause), correlation
    return best


def _twice(values: Values, period_s: float) -> Values:
    return np.cumsum(np.cumsum(values)) * period_s**2


def _fitted(columns: "NDArray[np.floating[Any]]", values: Values) -> Values:
    found, *_ = np.linalg.lstsq(columns, values, rcond=None)
    return columns @ found


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
