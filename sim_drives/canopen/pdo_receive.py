"""RPDOs of one node (CiA 301 7.2.2): what a received PDO does.

Rules:
1. Shorter than mapped: ignored, 8210h. Longer: 8220h, and the mapped first bytes are used.
2. Types 0 to 240 wait for the next SYNC and are applied there, all PDOs together, newest data of
   each, the controlword last: target and controlword of one cycle are never separated. One that
   comes after the synchronous window counts as not received. 254, 255: at once.
3. Event timer (where the drive has one): starts with the first PDO; if it expires without another
   one the error is 8250h, which the next PDO ends.
4. 8210h, 8220h and 8250h last until no PDO has them any more. They end when the node leaves
   operational or the PDO's objects are written; data waiting for a SYNC is then dropped.
5. An object's value that its range or guard refuses is not stored; the others of the PDO are.
"""

from collections.abc import Callable, Sequence
from typing import Final

from sim_drives.canopen.context import NodeContext
from sim_drives.canopen.objects import Object
from sim_drives.canopen.pdo_channel import Settings, Values, channels
from sim_drives.canopen.pdo_rules import PDO_COUNT, Direction, Layout
from sim_drives.canopen.sync import SyncConsumer

SHORT_PDO: Final = 0x8210
LONG_PDO: Final = 0x8220
CONTROLWORD: Final = (Object.CONTROLWORD, 0)


class _Complaint:
    """An error of several PDOs: begins with the first PDO that has it, ends with the last."""

    def __init__(self, report: Callable[[bool], None]) -> None:
        self._report = report
        self._slots: set[int] = set()

    def report(self, slot: int, *, wrong: bool) -> None:
        if wrong == (slot in self._slots):
            return
        before = bool(self._slots)
        self._slots ^= {slot}
        if bool(self._slots) != before:
            self._report(wrong)


class ReceivePdos:
    """All RPDOs of one node."""

    def __init__(
        self,
        context: NodeContext,
        sync: SyncConsumer,
        apply: Callable[[Values], None],
        report: Callable[[int, bool], None],
        on_timeout: Callable[[bool], None],
        *,
        locked: bool,
    ) -> None:
        """Start with no PDO received.

        `apply` receives the values of all PDOs that act now; `report` an error code and whether the
        error is present; `on_timeout` whether PDOs are missing.
        """
        dictionary, self._line, self._timers = context
        self._channels = channels(dictionary, Direction.RECEIVE, self._reset_slot, locked=locked)
        self._sync = sync
        self._apply = apply
        self._too_short = _Complaint(lambda wrong: report(SHORT_PDO, wrong))
        self._too_long = _Complaint(lambda wrong: report(LONG_PDO, wrong))
        self._missing = _Complaint(on_timeout)
        self._waiting: list[Values] = [[] for _ in range(PDO_COUNT)]

    def reset(self) -> None:
        """Drop all state after parameters have been restored."""
        self.leave_operational()
        for channel in self._channels:
            channel.invalidate()

    def leave_operational(self) -> None:
        """End the errors and drop waiting data (rule 4)."""
        for slot in range(PDO_COUNT):
            self._reset_slot(slot)

    def _reset_slot(self, slot: int) -> None:
        self._waiting[slot] = []
        self._timers.cancel((Direction.RECEIVE, slot))
        for complaint in (self._too_short, self._too_long, self._missing):
            complaint.report(slot, wrong=False)

    def drop_waiting(self) -> None:
        """Drop the data that waits for a SYNC."""
        self._waiting = [[] for _ in range(PDO_COUNT)]

    def slots(self) -> dict[int, list[int]]:
        """Return the numbers of the PDOs, from 0, by their CAN identifier."""
        found: dict[int, list[int]] = {}
        for slot, channel in enumerate(self._channels):
            if (can_id := channel.can_id) is not None:
                found.setdefault(can_id, []).append(slot)
        return found

    def receive(self, slots: Sequence[int], data: bytes) -> None:
        """Process the data of a frame that is each of these PDOs."""
        for slot in slots:
            self._receive(slot, self._channels[slot].settings, data)

    def _receive(self, slot: int, settings: Settings, data: bytes) -> None:
        if settings.synchronous and not self._sync.within_window():
            return
        size = settings.layout.packing.size
        self._too_short.report(slot, wrong=len(data) < size)
        if len(data) < size:
            return
        self._too_long.report(slot, wrong=len(data) > size)
        self._watch(slot, settings)
        values = _values(settings.layout, data[:size])
        if settings.synchronous:
            self._waiting[slot] = values
        else:
            self._apply(_controlword_last(values))

    def _watch(self, slot: int, settings: Settings) -> None:
        self._missing.report(slot, wrong=False)
        if settings.event_timer_ns:
            name, at_ns = (Direction.RECEIVE, slot), self._line.now_ns + settings.event_timer_ns
            self._timers.start(name, at_ns, lambda: self._missing.report(slot, wrong=True))

    def sync(self) -> None:
        """Apply the data received since the last SYNC (rule 2)."""
        values = [value for waiting in self._waiting for value in waiting]
        self.drop_waiting()
        if values:
            self._apply(_controlword_last(values))


def _values(layout: Layout, data: bytes) -> Values:
    return list(zip(layout.addresses, layout.packing.unpack(data), strict=True))


def _controlword_last(values: Values) -> Values:
    return sorted(values, key=lambda value: value[0] == CONTROLWORD)
