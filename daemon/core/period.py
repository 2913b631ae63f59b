"""The period of the core's cycle, and durations in cycles."""

from typing import Final

PERIOD_S: Final = 0.010
"""The only value that a trainer file may have (`daemon/config/settings.py`)."""


def cycles(duration_s: float) -> int:
    """The number of cycles in a duration."""
    return round(duration_s / PERIOD_S)
