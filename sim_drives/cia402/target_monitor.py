"""Monitoring of cyclic position targets on the makes of drive that have it (8250h).

Each RPDO restarts the monitor; none for TARGET_PATIENCE times 60C2h is a lost connection. One
skipped target is therefore an error, and a 60C2h shorter than the SYNC period always is. 60C2h = 0
disables the monitor.
"""

from collections.abc import Callable
from typing import Final

from sim_drives.canopen.line import Line
from sim_drives.canopen.timers import Timers

TARGET_TIMEOUT: Final = 1.5
"""Time limit in interpolation periods."""


class TargetWatch:
    """The target monitor of one drive; `wanted` returns whether the drive follows targets now."""

    def __init__(self, line: Line, timers: Timers, wanted: Callable[[], bool]) -> None:
        self._line = line
        self._timers = timers
        self._wanted = wanted
        self.on_missed: Callable[[], None] = lambda: None

    def pdos_applied(self, interpolation_s: float) -> None:
        """Restart the monitor with the present 60C2h: RPDOs have been applied."""
        if interpolation_s and self._wanted():
            at_ns = self._line.now_ns + round(TARGET_TIMEOUT * interpolation_s * 1e9)
            self._timers.start(TargetWatch, at_ns, self._miss)

    def _miss(self) -> None:
        if self._wanted():
            self.on_missed()
