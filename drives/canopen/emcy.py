"""Emergency messages of one drive: decoded, counted, the newest ones kept, the open one shown.

Rules (CiA 301 7.2.7.1):
1.  An EMCY is eight bytes: code, error register, five of the vendor's. Code 0000h means that all
    errors are gone: it clears the open one and is not counted as an error.
2.  The meaning of a code, the drive's own reaction and whether its encoder is still reliable depend
    on the vendor (`emcy_codes.py`). A code with an unknown reaction counts as the worst.
3.  An alarm requires a stop: every code that is not only a warning. A warning is reported, and
    never hides an open alarm.
4.  Memory is bounded: rings of fixed length keep the newest, the counters stay exact, and a code
    already received since the last 0000h is marked as a repetition, which requires no new stop.
"""

import struct
from collections import deque
from typing import Final

from drives.canopen.emcy_codes import Codes, Reaction, meaning
from drives.signals import Emergency

EMERGENCY_ID: Final = 0x080
RING_COUNT: Final = 32
NEWS_COUNT: Final = 2
"""Messages of one cycle that fit into its record; all are counted."""

_LAYOUT: Final = struct.Struct("<HB5s")


def decode_emergency(data: bytes, node_id: int, codes: Codes, now_ns: int) -> Emergency | None:
    """Decode one EMCY frame; None if it is not eight bytes long."""
    if len(data) != _LAYOUT.size:
        return None
    code, register, vendor_bytes = _LAYOUT.unpack(data)
    means = meaning(code, codes)
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
    """True if the EMCY requires a stop."""
    return emergency.code != 0 and emergency.reaction is not Reaction.WARNING


class EmergencyLog:
    """Emergencies of one drive since bring-up."""

    def __init__(self, node_id: int, codes: Codes) -> None:
        self._node_id = node_id
        self._codes = codes
        self.ring: deque[Emergency] = deque(maxlen=RING_COUNT)
        """The newest messages with a code, oldest first."""
        self.open: Emergency | None = None
        """The newest alarm that no code 0000h has cleared; without one, the newest warning."""
        self.count = 0
        """Messages with a code."""
        self.alarm: Emergency | None = None
        """The newest alarm, cleared since or not."""
        self.alarm_count = 0
        """Number of alarms among them."""
        self.has_alarm = False
        """The last frame is an alarm whose code is new since the last 0000h."""
        self.reference_lost = False
        """One of the messages meant that the encoder position is no longer reliable."""
        self._since_clear: set[int] = set()
        self._news: deque[tuple[Emergency, bool]] = deque(maxlen=NEWS_COUNT)

    def has_told(self, code: int) -> bool:
        """True if one of the newest messages has this code."""
        return any(one.code == code for one in self.ring)

    def feed(self, data: bytes, now_ns: int) -> Emergency | None:
        """Take one EMCY frame; return it decoded, or None if it has the wrong length.

        `has_alarm` is True if it requires a stop that was not required before.
        """
        self.has_alarm = False
        emergency = decode_emergency(data, self._node_id, self._codes, now_ns)
        if emergency is None:
            return None
        if emergency.code == 0:
            self.open = None
            self._since_clear.clear()
        else:
            self._add(emergency)
        return emergency

    def take_news(self) -> tuple[tuple[Emergency, bool], ...]:
        """Return news since the last call, oldest first, with True for repeated open codes."""
        if not self._news:
            return ()
        news = tuple(self._news)
        self._news.clear()
        return news

    def _add(self, emergency: Emergency) -> None:
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
