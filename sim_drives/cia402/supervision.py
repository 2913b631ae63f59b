"""Motion errors that an enabled drive detects itself.

| error | when |
|---|---|
| 8611h | the following error was outside 6065h for 6066h |
| 8A82h | `position_limit = "fault"`: position or target outside 607Dh, once there is a reference |
| 8A80h, 8A81h | `limit_switch = "fault"`: the negative, the positive switch has closed |

A switch that was closed at enabling is no error, so that the axis can be driven off it. None of
this is checked while a homing moves: the search has its own rules (`homing.py`).
"""

from collections.abc import Iterator
from typing import Final

from sim_drives.cia402.measurement import NEGATIVE_SWITCH, POSITIVE_SWITCH, Measurement
from sim_drives.cia402.motion import Motion
from sim_drives.plant.actuation import AxisFlag
from sim_drives.settings import DriveSettings, LimitSwitch, PositionLimit

FOLLOWING_ERROR_CODE: Final = 0x8611
SOFT_LIMIT_CODE: Final = 0x8A82
SWITCH_CODES: Final = {NEGATIVE_SWITCH: 0x8A80, POSITIVE_SWITCH: 0x8A81}


class Supervision:
    """The motion supervision of one axis."""

    def __init__(self, settings: DriveSettings, motion: Motion, measurement: Measurement) -> None:
        self._limits_fault = settings.position_limit is PositionLimit.FAULT
        self._switches_fault = settings.limit_switch is LimitSwitch.FAULT
        self._motion = motion
        self._measurement = measurement
        self._switches_prev = 0

    def reset(self, flags: int) -> None:
        """Reset while not enabled: no error, and a switch closed now is ignored later."""
        self._switches_prev = self._measurement.switches(flags)

    def errors(self, flags: int) -> Iterator[int]:
        """Return the codes of the present errors, in "operation enabled"."""
        switches = self._measurement.switches(flags)
        closed = switches & ~self._switches_prev
        self._switches_prev = switches
        if self._motion.homing.moves:
            return
        if flags & AxisFlag.FOLLOWING_ERROR:
            yield FOLLOWING_ERROR_CODE
        guarded = self._limits_fault and self._measurement.referenced
        if guarded and self._motion.outside_position_limits():
            yield SOFT_LIMIT_CODE
        if self._switches_fault:
            yield from (code for switch, code in SWITCH_CODES.items() if closed & switch)
