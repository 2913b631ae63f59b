"""The watch over the targets of cyclic position, where a make of drive has one (8250h).

Each RPDO begins it anew; none for TARGET_PATIENCE times 60C2h is a lost connection. So one skipped
target is missed, and a 60C2h shorter than the SYNC period misses them all. 60C2h = 0 watches
nothing.
"""

from collections.abc import Callable
from typing import Final

from sim_drives.canopen.line import Line
from sim_drives.canopen.timers import Timers

TARGET_PATIENCE: Final = 1.5
"""Interpolation periods."""


class TargetWatch:
    """Of one drive; `wanted` says whether the drive follows targets now."""

    def __init__(self, line: Line, timers: Timers, wanted: Callable[[], bool]) -> None:
        self._line = line
        self._timers = timers
        self._wanted = wanted
        self.on_missed: Callable[[], None] = lambda: None

    def pdo_came(self, interpolation_s: float) -> None:
        """RPDOs have been applied, with 60C2h as it is now."""
        if interpolation_s and self._wanted():
            at_ns = self._line.now_ns + round(TARGET_PATIENCE * interpolation_s * 1e9)
            self._timers.start(TargetWatch, at_ns, self._miss)

    def _miss(self) -> None:
        if self._wanted():
            self.on_missed()
