"""A figure of accuracy over several draws of the noise: median and range."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np


class Spread(NamedTuple):
    """Median and range of a figure over the draws that have it."""

    value: float
    """The median, in the unit of the figure; so are the others."""
    value_low: float
    value_high: float


def spread(values: Iterable[float | None]) -> Spread | None:
    """Summarise the draws; None without any. None and NaN are draws that have no value."""
    known = np.array([value for value in values if value is not None], dtype=float)
    known = known[np.isfinite(known)]
    if not len(known):
        return None
    return Spread(float(np.median(known)), float(known.min()), float(known.max()))


def in_words(found: Spread | None, unit: str = "") -> str:
    """Format a spread as `median (low … high) unit`; one number where all draws give the same."""
    if found is None:
        return "–"
    median, low, high = map(rounded, found)
    both = median if low == median == high else f"{median} ({low} … {high})"
    return f"{both} {unit}".rstrip()


def rounded(value: float) -> str:
    """Format a number with three digits, whole, or with at most four decimals."""
    if abs(value) >= 100:
        return f"{value:.0f}"
    return f"{value:.3g}" if abs(value) >= 1e-4 or not value else f"{value:.4f}"
