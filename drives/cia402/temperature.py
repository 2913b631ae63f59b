"""Temperatures that no PDO carries: read by SDO in the cycle, one upload at a time on the bus.

Rules:
1.  The drives take turns: each turn of SLOT_CYCLES belongs to one of them. Only one upload is
    outstanding, so there is at most one more frame in a cycle, and one answer.
2.  The request leaves after the commands of its cycle, and never in place of one.
3.  A server serves one client. While another client uses a drive's server, the request waits; the
    service's tools read objects in this way (`drives/service`).
4.  An answer counts until its turn is over. A turn without one is missed, whatever the reason: no
    answer, an abort, another length. After MISSED_MAX of them in a row the temperature is not
    measured; after BLOCKED_MAX in a row in which another client left no room for the request, too.
    Nothing else follows from it: a drive that is silent is found by its TPDOs.

Source: CiA 301 7.2.4.3.6, SDO upload; a temperature has four bytes at most, so it is expedited.
"""

from collections.abc import Sequence
from typing import Final

from drives.canopen.bus import Frame
from drives.canopen.sdo import upload_request, uploaded
from drives.cia402.profile import Temperature

SLOT_CYCLES: Final = 25
QUIET_CYCLES: Final = 5
"""Cycles without a request of another client after which a drive's server is free."""
MISSED_MAX: Final = 3
BLOCKED_MAX: Final = 20
"""Ten seconds with two drives; a dump of all objects of a drive takes two or three."""


class TemperatureUpload:
    """The temperature of one drive, and the state of its upload."""

    def __init__(self, node_id: int, temperature: Temperature) -> None:
        """No temperature is known before the first answer."""
        self.degc: float | None = None
        self._object = temperature
        self._request = upload_request(node_id, temperature.index, temperature.sub)
        self._awaited = False
        self._answered = False
        self._missed_count = self._blocked_count = 0
        self._quiet_cycles = QUIET_CYCLES

    @property
    def overdue(self) -> bool:
        """True if the temperature is not measured (rule 4)."""
        return self._missed_count >= MISSED_MAX or self._blocked_count >= BLOCKED_MAX

    def begin_turn(self) -> None:
        """The drive's turn begins."""
        self._awaited = self._answered = False

    def end_turn(self) -> None:
        """The drive's turn is over."""
        if self._answered:
            self._missed_count = self._blocked_count = 0
        elif self._awaited:
            self._missed_count += 1
        else:
            self._blocked_count += 1
        self._awaited = False
        if self.overdue:
            self.degc = None

    def pass_cycle(self) -> None:
        """A cycle has passed, in any turn."""
        self._quiet_cycles += 1

    def request(self) -> list[Frame]:
        """The request, once in a turn, as soon as the drive's server is free."""
        if self._awaited or self._answered or self._quiet_cycles < QUIET_CYCLES:
            return []
        self._awaited = True
        return [self._request]

    def on_foreign_request(self, _data: bytes, _now_ns: int, _in_window: bool) -> bool:
        """Take a request of another client to this drive."""
        self._quiet_cycles = 0
        return False

    def on_answer(self, data: bytes, _now_ns: int, _in_window: bool) -> bool:
        """Take an answer of this drive's server; other clients get theirs from it, too."""
        of = self._object
        value = uploaded(data, of.index, of.sub, of.bits)
        if self._awaited and value is not None:
            self.degc = int.from_bytes(value, "little", signed=of.signed) * of.degc_per_count
            self._awaited, self._answered = False, True
        return False


class TemperatureTurns:
    """Gives the drives of a bus their turns."""

    def __init__(self, uploads: Sequence[TemperatureUpload]) -> None:
        """Begin with the first drive."""
        self._uploads = tuple(uploads)
        self._turn = 0
        self._cycles_left = SLOT_CYCLES

    def request(self) -> list[Frame]:
        """The request of this cycle, if there is one; call once in a cycle."""
        if not self._uploads:
            return []
        if self._cycles_left == 0:
            self._uploads[self._turn].end_turn()
            self._turn = (self._turn + 1) % len(self._uploads)
            self._uploads[self._turn].begin_turn()
            self._cycles_left = SLOT_CYCLES
        self._cycles_left -= 1
        for upload in self._uploads:
            upload.pass_cycle()
        return self._uploads[self._turn].request()
