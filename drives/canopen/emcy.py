"""Emergency messages of one drive: decoded, counted, the newest ones kept, the open one shown.

Rules (CiA 301 7.2.7.1):
1.  An EMCY is eight bytes: code, error register, five of the vendor's. Code 0000h means that all
    errors are gone: it clears the open one and is not counted as an error.
2.  What the code means, what the drive does by itself and whether its encoder can still be believed
    is the vendor's (`emcy_codes.py`). A code whose reaction nobody knows is taken for the worst.
3.  An alarm asks for a stop: every code but those that are only a warning. A warning is told, and
    never hides an alarm that is still open.
4.  A flood fills nothing: rings of fixed length keep the newest, the counters stay exact, and a
    code that has come since the last 0000h is marked as a repetition, which asks for nothing new.
"""

import struct
from collections import deque
from typing import Final

from drives.canopen.emcy_codes import EmergencyTable, Reaction, meaning
from drives.signals import Emergency

EMERGENCY_ID: Final = 0x080
RING_COUNT: Final = 32
NEWS_COUNT: Final = 2
"""Messages of one cycle that its record has room for; all are counted."""

_LAYOUT: Final = struct.Struct("<HB5s")


def decode_emergency(
    data: bytes, node_id: int, table: EmergencyTable, now_ns: int
) -> Emergency | None:
    """One EMCY frame; None if it has not eight bytes."""
    if len(data) != _LAYOUT.size:
        return None
    code, register, vendor_bytes = _LAYOUT.unpack(data)
    means = meaning(code, table)
    return Emergency(
        node_id=node_id,
        code=code,
        error_register=register,
        vendor_bytes=vendor_bytes,
        text=means.text,
        time_ns=now_ns,
        reaction=means.reaction,
        loses_reference=means.loses_reference,
    )


def is_alarm(emergency: Emergency) -> bool:
    """Whether it asks for a stop."""
    return emergency.code != 0 and emergency.reaction is not Reaction.WARNING


class EmergencyLog:
    """What one drive reported since bring-up."""

    __slots__ = (
        "_news",
        "_node_id",
        "_since_clear",
        "_table",
        "alarm",
        "alarm_count",
        "cleared_count",
        "count",
        "has_alarm",
        "open",
        "reference_lost",
        "ring",
    )

    def __init__(self, node_id: int, table: EmergencyTable) -> None:
        self._node_id = node_id
        self._table: EmergencyTable = table
        self.ring: deque[Emergency] = deque(maxlen=RING_COUNT)
        """The newest messages with a code, oldest first."""
        self.open: Emergency | None = None
        """The newest alarm that no code 0000h has cleared; without one, the newest warning."""
        self.count = 0
        """Messages with a code."""
        self.alarm: Emergency | None = None
        """The newest alarm, cleared since or not."""
        self.alarm_count = 0
        """Those among them that ask for a stop."""
        self.cleared_count = 0
        """Messages with code 0000h."""
        self.has_alarm = False
        """The last frame asks for a stop, and its code is new since the last 0000h."""
        self.reference_lost = False
        """One of them said that the encoder cannot be believed any more."""
        self._since_clear: set[int] = set()
        self._news: deque[tuple[Emergency, bool]] = deque(maxlen=NEWS_COUNT)

    def feed(self, data: bytes, now_ns: int) -> Emergency | None:
        """Take one EMCY frame; what it says, or None if it has the wrong length.

        `has_alarm` tells whether it asks for a stop that was not asked for before.
        """
        self.has_alarm = False
        emergency = decode_emergency(data, self._node_id, self._table, now_ns)
        if emergency is None:
            return None
        if emergency.code == 0:
            self.cleared_count += 1
            self.open = None
            self._since_clear.clear()
        else:
            self._note(emergency)
        return emergency

    def take_news(self) -> tuple[tuple[Emergency, bool], ...]:
        """What came since the last call, oldest first; each with: does it repeat an open code?"""
        if not self._news:
            return ()
        news = tuple(self._news)
        self._news.clear()
        return news

    def _note(self, emergency: Emergency) -> None:
        alarm = is_alarm(emergency)
        self.count += 1
        self.alarm_count += alarm
        self.alarm = emergency if alarm else self.alarm
        self.reference_lost |= emergency.loses_reference
        if alarm or self.open is None or not is_alarm(self.open):
            self.open = emergency
        self.ring.append(emergency)
        repeated = emergency.code in self._since_clear
        self.has_alarm = alarm and not repeated
        self._news.append((emergency, repeated))
        self._since_clear.add(emergency.code)
