"""Emergency messages of one drive: decoded, counted, the newest ones kept, the open one shown.

Rules (CiA 301 7.2.7.1): an EMCY is eight bytes: code, error register, five of the vendor's. Code
0000h means that all errors are gone: it clears the open one and is not counted as an error. A
flood fills nothing: a ring of fixed length keeps the newest, the counters stay exact.
"""

import struct
from collections import deque
from typing import Final

from drives.emcy_codes import EmergencyTable, meaning
from drives.signals import Emergency

EMERGENCY_ID: Final = 0x080
RING_COUNT: Final = 32

_LAYOUT: Final = struct.Struct("<HB5s")


def decode_emergency(
    data: bytes, node_id: int, table: EmergencyTable, now_ns: int
) -> Emergency | None:
    """One EMCY frame; None if it has not eight bytes."""
    if len(data) != _LAYOUT.size:
        return None
    code, register, vendor_bytes = _LAYOUT.unpack(data)
    text = meaning(code, table).text
    return Emergency(node_id, code, register, vendor_bytes, text, now_ns)


class EmergencyLog:
    """What one drive reported since bring-up."""

    __slots__ = ("_node_id", "_table", "cleared_count", "count", "open", "ring")

    def __init__(self, node_id: int, table: EmergencyTable) -> None:
        self._node_id = node_id
        self._table: EmergencyTable = table
        self.ring: deque[Emergency] = deque(maxlen=RING_COUNT)
        """The newest messages with a code, oldest first."""
        self.open: Emergency | None = None
        """The newest one that no code 0000h has cleared."""
        self.count = 0
        """Messages with a code."""
        self.cleared_count = 0
        """Messages with code 0000h."""

    def feed(self, data: bytes, now_ns: int) -> Emergency | None:
        """Take one EMCY frame; what it says, or None if it has the wrong length."""
        emergency = decode_emergency(data, self._node_id, self._table, now_ns)
        if emergency is None:
            return None
        if emergency.code == 0:
            self.cleared_count += 1
            self.open = None
        else:
            self.count += 1
            self.open = emergency
            self.ring.append(emergency)
        return emergency
