"""State of the CAN controller: SocketCAN error frames, decoded and counted.

canopen drops these frames and python-can's `bus.state` is always ACTIVE, so a bus-off would pass
undetected without this file. Source of the numbers: include/uapi/linux/can/error.h.

Rules:
1.  Bus-off lasts until the controller reports a restart. This program never restarts it: the
    interface does (`restart-ms`, or the operator). Frames of other nodes in the meantime are lost.
    A report can be lost, too: bring-up takes the controller for restarted when any frame is
    received, or when the operator has requested it.
2.  Error passive and warning are reported and do not stop. They end when the controller says so.
3.  A missing acknowledgement means that no other node is on the bus; any received frame ends that.
    A transmitter that is error passive before any frame was received means the same: the error
    counter of a single node rises no further (ISO 11898-1), and not every driver reports the
    missing acknowledgement.
4.  Everything is counted; a notice is made for each change, and for repeated events (frames lost in
    the controller) for the first, the tenth, the hundredth.
"""

from collections import deque
from enum import Enum
from typing import Final

from drives.canopen.bus import Frame

_CLASS_CONTROLLER: Final = 0x004
_CLASS_PROTOCOL: Final = 0x008
_CLASS_NO_ACK: Final = 0x020
_CLASS_BUS_OFF: Final = 0x040
_CLASS_BUS_ERROR: Final = 0x080
_CLASS_RESTARTED: Final = 0x100

_DATA_OVERFLOW: Final = 0x03
_DATA_WARNING: Final = 0x0C
_DATA_PASSIVE: Final = 0x30
_DATA_TRANSMITTER_PASSIVE: Final = 0x20
_DATA_ACTIVE: Final = 0x40
_PROTOCOL_ACTIVE: Final = 0x40
"""Bit in data[2] of a protocol error: a driver (usb_8dev) uses it to report the error-free
state."""
_ACK_SLOT: Final = 0x19
"""data[3] of a protocol error: some drivers report a missing acknowledgement by its location."""

NOTICES_MAX: Final = 4
"""Most notices of one cycle; faster changes are only counted."""


class BusCondition(Enum):
    """The controller's fault confinement state (ISO 11898-1)."""

    ACTIVE = "active"
    WARNING = "warning"
    PASSIVE = "error passive"
    OFF = "bus-off"


class BusNotice(Enum):
    """A change of the controller that an operator should know."""

    ACTIVE = "works without errors again"
    WARNING = "sees many errors"
    PASSIVE = "is error passive"
    OFF = "is bus-off"
    ALONE = "its frames are not acknowledged"
    FRAMES_LOST = "lost frames"


_NOTICE: Final = {
    BusCondition.ACTIVE: BusNotice.ACTIVE,
    BusCondition.WARNING: BusNotice.WARNING,
    BusCondition.PASSIVE: BusNotice.PASSIVE,
    BusCondition.OFF: BusNotice.OFF,
}


class BusMonitor:
    """Decodes every error frame; holds the condition and the counters."""

    def __init__(self) -> None:
        self.condition = BusCondition.ACTIVE
        self.has_been_off = False
        """Bus-off since the drives were brought up: even a short one means that they missed
        frames."""
        self.alone = False
        """Frames are not acknowledged, and none has been received since."""
        self._has_received = False
        self.bus_off_count = 0
        self.passive_count = 0
        self.warning_count = 0
        self.restart_count = 0
        self.no_ack_count = 0
        self.overflow_count = 0
        """Frames lost in the controller, in either direction."""
        self._overflow_reported_count = 0
        self._notices: deque[BusNotice] = deque(maxlen=NOTICES_MAX)

    def feed(self, frame: Frame) -> bool:
        """Take one error frame; True if the condition changed."""
        before = self.condition
        kinds = frame.can_id
        if kinds & _CLASS_NO_ACK or (kinds & _CLASS_PROTOCOL and _is_at(frame.data, _ACK_SLOT)):
            self.no_ack_count += 1
            self._set_alone()
        if kinds & _CLASS_CONTROLLER and len(frame.data) > 1:
            self._controller(frame.data[1])
        elif _announces_active(frame):
            self._set_active()
        if kinds & _CLASS_RESTARTED:
            self.restart_count += 1
            self.condition = BusCondition.ACTIVE
        if kinds & _CLASS_BUS_OFF:
            self.bus_off_count += 1
            self.has_been_off = True
            self.condition = BusCondition.OFF
        if self.condition is before:
            return False
        self._notices.append(_NOTICE[self.condition])
        return True

    def begin(self) -> None:
        """Reset the state after the interface was opened."""
        self.condition = BusCondition.ACTIVE
        self.alone = self._has_received = False

    def reset_history(self) -> None:
        """Clear the history when bring-up starts: it must not count against the drives."""
        self.has_been_off = False

    def assume_restarted(self) -> None:
        """Assume that a controller that was bus-off has restarted."""
        if self.condition is BusCondition.OFF:
            self.condition = BusCondition.ACTIVE
            self._notices.append(_NOTICE[BusCondition.ACTIVE])

    def frame_received(self) -> None:
        """Note a frame from another node."""
        self.alone = False
        self._has_received = True

    def take_notices(self) -> list[BusNotice]:
        """Return the notices that were not yet taken, oldest first."""
        notices = list(self._notices)
        self._notices.clear()
        return notices

    def _set_alone(self) -> None:
        if not self.alone:
            self._notices.append(BusNotice.ALONE)
        self.alone = True

    def _controller(self, status: int) -> None:
        if status & _DATA_OVERFLOW:
            self._overflow()
        if self.condition is BusCondition.OFF:
            return
        if status & _DATA_PASSIVE:
            self.passive_count += 1
            self.condition = BusCondition.PASSIVE
            if status & _DATA_TRANSMITTER_PASSIVE and not self._has_received:
                self._set_alone()
        elif status & _DATA_WARNING:
            self.warning_count += 1
            self.condition = BusCondition.WARNING
        elif status & _DATA_ACTIVE:
            self._set_active()

    def _set_active(self) -> None:
        if self.condition is not BusCondition.OFF:
            self.condition = BusCondition.ACTIVE

    def _overflow(self) -> None:
        self.overflow_count += 1
        if self.overflow_count >= 10 * self._overflow_reported_count:
            self._overflow_reported_count = self.overflow_count
            self._notices.append(BusNotice.FRAMES_LOST)


def _announces_active(frame: Frame) -> bool:
    # With the class of bus errors it reports one more of them.
    only = frame.can_id & (_CLASS_PROTOCOL | _CLASS_BUS_ERROR) == _CLASS_PROTOCOL
    return only and len(frame.data) > 2 and bool(frame.data[2] & _PROTOCOL_ACTIVE)


def _is_at(data: bytes, place: int) -> bool:
    return len(data) > 3 and data[3] == place
