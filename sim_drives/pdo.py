"""PDOs of one node at work (CiA 301 7.2.2): what is sent when, and what a received one does.

Rules, transmit:
1. Type 1 to 240: at every n-th SYNC, with what was sampled at that SYNC; counted from the entry
   into operational. Type 0: at the next SYNC after the mapped data has changed.
2. Types 254 and 255: when the mapped data has changed, not sooner than the inhibit time (100 µs)
   after the last one; and when the event timer (ms) has run out; once on entering operational.
   A change is looked for at each SYNC and after whatever may have changed the drive's state.
Rules, receive:
3. Shorter than mapped: ignored, 8210h. Longer: 8220h, and the mapped first bytes are used.
4. Types 0 to 240 wait for the next SYNC and are applied there, all PDOs in one go, newest data of
   each, the controlword last: target and controlword of one cycle never part. 254, 255: at once.
5. Event timer (where the drive has one): from the first PDO on, none for so long is 8250h; the next
   one ends it.
6. An object's value that its range or guard refuses is not stored; the others of the PDO are.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

from sim_drives.dictionary import Address, ObjectDictionary
from sim_drives.frame import Frame
from sim_drives.line import Line
from sim_drives.pdo_rules import (
    CAN_ID_MASK,
    PDO_COUNT,
    SUB_EVENT_TIMER,
    SUB_INHIBIT,
    SUB_TYPE,
    Direction,
    Layout,
    PdoObjects,
)
from sim_drives.timers import MILLISECOND, Timers

LAST_SYNCHRONOUS_TYPE: Final = 240
_INHIBIT_STEP_NS: Final = 100_000
Values = list[tuple[Address, int]]


class _Settings(NamedTuple):
    """One PDO as its objects have it."""

    valid: bool
    can_id: int
    type: int
    synchronous: bool
    inhibit_ns: int
    event_timer_ns: int
    layout: Layout


class _Channel:
    """One PDO; its objects are read again only after one of them has been written."""

    def __init__(self, objects: PdoObjects) -> None:
        self._objects = objects
        self._settings: _Settings | None = None
        objects.install_guards()
        for index in (objects.parameters, objects.mapping):
            objects.dictionary.watch(index, lambda _: self.forget())

    @property
    def number(self) -> int:
        """Counted from 1."""
        return self._objects.number + 1

    @property
    def settings(self) -> _Settings:
        if self._settings is None:
            self._settings = self._read()
        return self._settings

    def forget(self) -> None:
        """Parameters have changed."""
        self._settings = None

    def pack(self) -> bytes:
        value = self._objects.dictionary.value
        packing, addresses = self.settings.layout
        return packing.pack(*(value(*address) for address in addresses))

    def _read(self) -> _Settings:
        objects = self._objects
        kind = objects.dictionary.value(objects.parameters, SUB_TYPE)
        return _Settings(
            valid=objects.valid,
            can_id=objects.cob_id & CAN_ID_MASK,
            type=kind,
            synchronous=kind <= LAST_SYNCHRONOUS_TYPE,
            inhibit_ns=self._optional(SUB_INHIBIT) * _INHIBIT_STEP_NS,
            event_timer_ns=self._optional(SUB_EVENT_TIMER) * MILLISECOND,
            layout=objects.layout(),
        )

    def _optional(self, subindex: int) -> int:
        return self._objects.dictionary.value_or(self._objects.parameters, subindex, 0)


def _channels(
    dictionary: ObjectDictionary, direction: Direction, *, locked: bool
) -> list[_Channel]:
    return [
        _Channel(PdoObjects(dictionary, direction, number, locked)) for number in range(PDO_COUNT)
    ]


class TransmitPdos:
    """All TPDOs of one node. `delays_ns(n)` gives the latency of the n TPDOs of one SYNC."""

    def __init__(
        self,
        dictionary: ObjectDictionary,
        line: Line,
        timers: Timers,
        send: Callable[[int, Frame, int], None],
        delays_ns: Callable[[int], list[int]],
        *,
        locked: bool,
    ) -> None:
        self._channels = _channels(dictionary, Direction.TRANSMIT, locked=locked)
        self._line = line
        self._timers = timers
        self._send = send
        """(PDO number from 1, frame, delay in ns)."""
        self._delays_ns = delays_ns
        self._syncs = [0] * PDO_COUNT
        self._sent: list[bytes | None] = [None] * PDO_COUNT
        self._free_at_ns = [0] * PDO_COUNT

    def reset(self) -> None:
        """Parameters have been restored."""
        self.leave_operational()
        for channel in self._channels:
            channel.forget()

    def enter_operational(self) -> None:
        """Rules 1 and 2: start counting, and say what there is to say."""
        self._syncs = [0] * PDO_COUNT
        self._sent = [None] * PDO_COUNT
        self._free_at_ns = [0] * PDO_COUNT
        self.look_for_changes()

    def leave_operational(self) -> None:
        """Nothing more is sent."""
        for slot in range(PDO_COUNT):
            self._timers.cancel((Direction.TRANSMIT, "event", slot))
            self._timers.cancel((Direction.TRANSMIT, "inhibit", slot))

    def sync(self) -> None:
        """Send what this SYNC asks for; process values have been sampled."""
        due = [slot for slot in range(PDO_COUNT) if self._due_at_sync(slot)]
        for slot, delay_ns in zip(due, self._delays_ns(len(due)), strict=True):
            self._transmit(slot, delay_ns)
        self.look_for_changes()

    def _due_at_sync(self, slot: int) -> bool:
        channel = self._channels[slot]
        settings = channel.settings
        if not settings.valid or not settings.synchronous:
            return False
        if settings.type == 0:
            return channel.pack() != self._sent[slot]
        self._syncs[slot] += 1
        if self._syncs[slot] < settings.type:
            return False
        self._syncs[slot] = 0
        return True

    def look_for_changes(self) -> None:
        """Send event-driven PDOs whose data is not what was sent last."""
        for slot, channel in enumerate(self._channels):
            settings = channel.settings
            if settings.valid and not settings.synchronous and channel.pack() != self._sent[slot]:
                self._send_event(slot)

    def _send_event(self, slot: int) -> None:
        if self._line.now_ns >= self._free_at_ns[slot]:
            self._transmit(slot, 0)
        else:
            name = (Direction.TRANSMIT, "inhibit", slot)
            self._timers.start(name, self._free_at_ns[slot], self.look_for_changes)

    def _transmit(self, slot: int, delay_ns: int) -> None:
        channel, now_ns = self._channels[slot], self._line.now_ns
        settings, data = channel.settings, channel.pack()
        self._sent[slot] = data
        self._free_at_ns[slot] = now_ns + settings.inhibit_ns
        self._send(channel.number, Frame(settings.can_id, data), delay_ns)
        if not settings.synchronous and settings.event_timer_ns:
            at_ns = now_ns + settings.event_timer_ns
            name = (Direction.TRANSMIT, "event", slot)
            self._timers.start(name, at_ns, lambda: self._event_timer(slot))

    def _event_timer(self, slot: int) -> None:
        if self._channels[slot].settings.valid:
            self._transmit(slot, 0)


class ReceivePdos:
    """All RPDOs of one node."""

    def __init__(
        self,
        dictionary: ObjectDictionary,
        line: Line,
        timers: Timers,
        apply: Callable[[Values], None],
        on_length: Callable[[int, bool], None],
        on_timeout: Callable[[bool], None],
        *,
        locked: bool,
    ) -> None:
        self._channels = _channels(dictionary, Direction.RECEIVE, locked=locked)
        self._line = line
        self._timers = timers
        self._apply = apply
        self._on_length = on_length
        """(error code 8210h or 8220h, whether it is wrong now)."""
        self._on_timeout = on_timeout
        """Whether PDOs are missing now."""
        self._waiting: list[bytes | None] = [None] * PDO_COUNT

    def reset(self) -> None:
        """Parameters have been restored."""
        self.leave_operational()
        for channel in self._channels:
            channel.forget()

    def leave_operational(self) -> None:
        """What waits for a SYNC is void, and nothing is missing."""
        self._waiting = [None] * PDO_COUNT
        for slot in range(PDO_COUNT):
            self._timers.cancel((Direction.RECEIVE, slot))

    def receive(self, frame: Frame) -> None:
        """Take a frame that may be one of ours."""
        for slot, channel in enumerate(self._channels):
            settings = channel.settings
            if settings.valid and settings.can_id == frame.can_id:
                self._take(slot, settings, frame.data)

    def _take(self, slot: int, settings: _Settings, data: bytes) -> None:
        size = settings.layout.packing.size
        self._on_length(SHORT_PDO, len(data) < size)
        if len(data) < size:
            return
        self._on_length(LONG_PDO, len(data) > size)
        self._watch(slot, settings)
        if settings.synchronous:
            self._waiting[slot] = data[:size]
        else:
            self._apply(_controlword_last(_values(settings.layout, data[:size])))

    def _watch(self, slot: int, settings: _Settings) -> None:
        if settings.event_timer_ns:
            self._on_timeout(False)
            at_ns = self._line.now_ns + settings.event_timer_ns
            self._timers.start((Direction.RECEIVE, slot), at_ns, lambda: self._on_timeout(True))

    def sync(self) -> None:
        """Apply what has come since the last SYNC (rule 4)."""
        values: Values = []
        for slot, data in enumerate(self._waiting):
            if data is not None:
                values += _values(self._channels[slot].settings.layout, data)
        self._waiting = [None] * PDO_COUNT
        if values:
            self._apply(_controlword_last(values))


SHORT_PDO: Final = 0x8210
LONG_PDO: Final = 0x8220
CONTROLWORD: Final = (0x6040, 0)


def _values(layout: Layout, data: bytes) -> Values:
    return list(zip(layout.addresses, layout.packing.unpack(data), strict=True))


def _controlword_last(values: Values) -> Values:
    return sorted(values, key=lambda value: value[0] == CONTROLWORD)
