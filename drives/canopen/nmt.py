"""NMT and SYNC: the frames that a master sends, and the monitoring of one node's heartbeat.

Rules of the monitoring (CiA 301 7.2.8.2.2):
1.  A frame 700h + id with one byte 00h is a boot-up message: the node has reset and lost its
    configuration. It is not a heartbeat, and is remembered until a new bring-up.
2.  Any other state byte (bit 7, the toggle bit of node guarding, is masked) is a heartbeat.
3.  Monitoring runs from `armed_ns`, the end of bring-up, in which frames of the drive were
    received; without it, from the first heartbeat.
"""

from enum import IntEnum
from typing import Final

from drives.canopen.bus import Frame
from drives.signals import NmtState

NMT_ID: Final = 0x000
SYNC_ID: Final = 0x080
HEARTBEAT_ID: Final = 0x700

SYNC_FRAME: Final = Frame(SYNC_ID, b"")
"""SYNC without counter (1019h = 0)."""

_KNOWN: Final = {state.value: state for state in NmtState if state is not NmtState.UNKNOWN}


class NmtCommand(IntEnum):
    """Command specifiers of the NMT protocol (CiA 301 7.2.8.2.1)."""

    START = 0x01
    STOP = 0x02
    ENTER_PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


def nmt_frame(command: NmtCommand, node_id: int) -> Frame:
    """The NMT master's command to one node; 0 means all nodes."""
    return Frame(NMT_ID, bytes((command, node_id)))


def heartbeat_frame(node_id: int, state: NmtState = NmtState.OPERATIONAL) -> Frame:
    """The master's heartbeat, which the drives' 1016h monitors."""
    return Frame(HEARTBEAT_ID + node_id, bytes((state,)))


class SyncProducer:
    """Produces SYNC frames (CiA 301 7.2.5), with the counter of 1019h if there is one.

    The counter runs from 1 to the overflow value and counts frames, not time: a skipped grid point
    does not advance it. It starts with 1 when the nodes are started.
    """

    def __init__(self, overflow_count: int = 0) -> None:
        """`overflow_count` is 1019h: 0 for a SYNC without counter."""
        counted = [Frame(SYNC_ID, bytes((count,))) for count in range(1, overflow_count + 1)]
        self._frames = tuple(counted) or (SYNC_FRAME,)
        self._next = 0

    def restart(self) -> None:
        """NMT start: the next SYNC is the first."""
        self._next = 0

    def frame(self) -> Frame:
        """Return the SYNC that is due now."""
        frame = self._frames[self._next]
        self._next = (self._next + 1) % len(self._frames)
        return frame


class HeartbeatWatch:
    """Heartbeat monitoring of one node. Pure: time is an argument of each call."""

    def __init__(self, armed_ns: int | None = None) -> None:
        self._last_ns = armed_ns
        self.state = NmtState.UNKNOWN
        self.boot_up_count = 0
        self.strange_count = 0
        """Frames that are neither a heartbeat nor a boot-up message."""

    def feed(self, data: bytes, now_ns: int) -> bool:
        """Take one frame 700h + id; True if the node rebooted or changed its NMT state."""
        state = _KNOWN.get(data[0] & 0x7F) if len(data) == 1 else None
        if state is None:
            self.strange_count += 1
            return False
        changed = state is not self.state and self.state is not NmtState.UNKNOWN
        self.state = state
        if state is NmtState.BOOT_UP:
            self.boot_up_count += 1
            return True
        self._last_ns = now_ns
        return changed

    def age_ns(self, now_ns: int) -> int:
        """Time since the last heartbeat, or since monitoring was armed; 0 before either."""
        return 0 if self._last_ns is None else now_ns - self._last_ns
