"""What the CAN controller says about itself: SocketCAN error frames, decoded and counted.

canopen drops these frames and python-can's `bus.state` is always ACTIVE, so a bus-off would pass
unseen without this file. Source of the numbers: include/uapi/linux/can/error.h.

Rules: bus-off lasts until the controller reports a restart. Error passive and warning are events,
not stops. A missing acknowledgement alone means that nobody else is on the bus.
"""

from enum import Enum
from typing import Final

from drives.bus import Frame

_CLASS_CONTROLLER: Final = 0x004
_CLASS_NO_ACK: Final = 0x020
_CLASS_BUS_OFF: Final = 0x040
_CLASS_RESTARTED: Final = 0x100

_DATA_OVERFLOW: Final = 0x03
_DATA_WARNING: Final = 0x0C
_DATA_PASSIVE: Final = 0x30
_DATA_ACTIVE: Final = 0x40


class BusCondition(Enum):
    """The controller's fault confinement state (ISO 11898-1)."""

    ACTIVE = "active"
    WARNING = "warning"
    PASSIVE = "error passive"
    OFF = "bus-off"


class BusMonitor:
    """Takes every error frame; holds the condition and what was counted."""

    __slots__ = (
        "bus_off_count",
        "condition",
        "no_ack_count",
        "overflow_count",
        "passive_count",
        "restart_count",
    )

    def __init__(self) -> None:
        self.condition = BusCondition.ACTIVE
        self.bus_off_count = 0
        self.passive_count = 0
        self.restart_count = 0
        self.no_ack_count = 0
        self.overflow_count = 0
        """Frames lost in the controller, received or to be sent."""

    def feed(self, frame: Frame) -> bool:
        """Take one error frame; True if the condition changed."""
        before = self.condition
        kinds = frame.can_id
        self.no_ack_count += bool(kinds & _CLASS_NO_ACK)
        if kinds & _CLASS_CONTROLLER and len(frame.data) > 1:
            self._controller(frame.data[1])
        if kinds & _CLASS_RESTARTED:
            self.restart_count += 1
            self.condition = BusCondition.ACTIVE
        if kinds & _CLASS_BUS_OFF:
            self.bus_off_count += 1
            self.condition = BusCondition.OFF
        return self.condition is not before

    def _controller(self, status: int) -> None:
        self.overflow_count += bool(status & _DATA_OVERFLOW)
        if self.condition is BusCondition.OFF:
            return
        if status & _DATA_PASSIVE:
            self.passive_count += 1
            self.condition = BusCondition.PASSIVE
        elif status & _DATA_WARNING:
            self.condition = BusCondition.WARNING
        elif status & _DATA_ACTIVE:
            self.condition = BusCondition.ACTIVE
