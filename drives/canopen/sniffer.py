"""Passive observation of a bus: every frame is counted, none is evaluated.

`BusSniffer` takes all frames, those of this program too; `SniffedBus` wraps any `Bus`, so all
traffic over that bus is recorded. Rules:
1.  An answer belongs to a request of this program or of another client. An object is judged that
    this program has requested: more answers than requests, counted from the first request on, means
    that two nodes answer. Answers before it are another client's, whose request came before the bus
    was opened.
2.  A request that this program did not send means another SDO client: a bring-up, or a tool.
3.  Identifiers are counted as they come; `inventory.py` attributes them to their senders.
"""

import struct
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from drives.canopen.bus import Bus, Clock, Frame
from drives.canopen.bus_state import BusCondition, BusMonitor
from drives.canopen.emcy import EMERGENCY_ID
from drives.canopen.nmt import HEARTBEAT_ID, NMT_ID, SYNC_ID, HeartbeatWatch
from drives.canopen.sdo import SDO_ANSWER_ID, SDO_REQUEST_ID

EMERGENCIES_KEPT: Final = 4

_SERVICE: Final = 0x780
_NODE: Final = 0x07F
_COMMAND: Final = 0xE0
_INITIATES: Final = frozenset((0x20, 0x40))
"""Client's command specifiers whose bytes 1..3 name an object: download, upload."""
_ANSWERS: Final = frozenset((0x40, 0x60))
"""The server's: upload, download (CiA 301 7.2.4.3). An abort may follow an answer."""
_ABORT: Final = 0x80
_OF_ONE_NODE: Final = frozenset((EMERGENCY_ID, SDO_ANSWER_ID, SDO_REQUEST_ID, HEARTBEAT_ID))


@dataclass(slots=True)
class NodeTraffic:
    """Traffic from and to one node."""

    watch: HeartbeatWatch = field(default_factory=HeartbeatWatch)
    heartbeat_count: int = 0
    emergencies: deque[bytes] = field(default_factory=lambda: deque[bytes](maxlen=EMERGENCIES_KEPT))
    requests: Counter[bytes] = field(default_factory=Counter[bytes])
    """Counts by bytes 1..3 of the request: index and sub-index."""
    own_requests: set[bytes] = field(default_factory=set[bytes])
    """Objects that this program has requested."""
    answers: Counter[bytes] = field(default_factory=Counter[bytes])
    """Answers since the first request for the object (rule 1)."""
    answered: bool = False
    """It has answered an SDO request of any client."""
    foreign_requests: Counter[bytes] = field(default_factory=Counter[bytes])
    """SDO requests to it from other clients, counted as `requests`; those without an object under
    no bytes."""

    @property
    def foreign_request_count(self) -> int:
        """SDO requests to it from other clients."""
        return self.foreign_requests.total()

    def foreign_count_besides(self, place: tuple[int, int] | None) -> int:
        """The same without those for one object, which a service reads in its cycle."""
        of_service = 0 if place is None else self.foreign_requests[struct.pack("<HB", *place)]
        return self.foreign_request_count - of_service

    @property
    def answered_twice(self) -> bool:
        """True if it gave more answers than there were requests (rule 1)."""
        return any(self.answers[of] > self.requests[of] for of in self.own_requests)


class BusSniffer:
    """Records every frame of a bus."""

    def __init__(self) -> None:
        self.nodes: dict[int, NodeTraffic] = {}
        self.bus_state = BusMonitor()
        self.received_count: Counter[int] = Counter()
        """Frames of other nodes, by identifier."""
        self._error_counts_before: tuple[int, int] | None = None
        """Error counts before the first sent frame: those errors have another cause."""
        self.odd_sync_count = 0
        """SYNCs with data: a counter byte, or more."""

    @property
    def sync_count(self) -> int:
        """Number of SYNCs received."""
        return self.received_count[SYNC_ID]

    @property
    def nmt_count(self) -> int:
        """Number of NMT commands received."""
        return self.received_count[NMT_ID]

    @property
    def is_silent(self) -> bool:
        """True if no frame of any node was received."""
        return not self.received_count

    @property
    def is_not_acknowledged(self) -> bool:
        """True if sent frames reach no node: bus-off, or no acknowledgement since the first one."""
        if self.bus_state.condition is BusCondition.OFF:
            return True
        asked = self._error_counts_before is not None
        return asked and self.is_silent and self._error_counts() != self._error_counts_before

    def node(self, node_id: int) -> NodeTraffic:
        """Traffic of one node."""
        return self.nodes.setdefault(node_id, NodeTraffic())

    def sent(self, frame: Frame) -> None:
        """Record a frame sent by this program."""
        if self._error_counts_before is None:
            self._error_counts_before = self._error_counts()
        if frame.can_id & _SERVICE == SDO_REQUEST_ID:
            traffic, place = self.node(frame.can_id & _NODE), _object_of(frame.data)
            if place:
                traffic.requests[place] += 1
                traffic.own_requests.add(place)

    def received(self, frame: Frame, now_ns: int) -> None:
        """Record a frame of another node, or an error frame of the controller."""
        if frame.is_error:
            self.bus_state.feed(frame)
            return
        self.received_count[frame.can_id] += 1
        service, node_id = frame.can_id & _SERVICE, frame.can_id & _NODE
        if frame.can_id == SYNC_ID:
            self.odd_sync_count += bool(frame.data)
        elif node_id and service in _OF_ONE_NODE:
            self._received_of_node(self.node(node_id), service, frame.data, now_ns)

    def _error_counts(self) -> tuple[int, int]:
        return self.bus_state.no_ack_count, self.bus_state.passive_count

    def _received_of_node(
        self, traffic: NodeTraffic, service: int, data: bytes, now_ns: int
    ) -> None:
        if service == HEARTBEAT_ID:
            others = traffic.watch.boot_up_count + traffic.watch.strange_count
            traffic.watch.feed(data, now_ns)
            traffic.heartbeat_count += (
                traffic.watch.boot_up_count + traffic.watch.strange_count == others
            )
        elif service == EMERGENCY_ID:
            traffic.emergencies.append(data)
        elif service == SDO_REQUEST_ID:
            place = _object_of(data)
            traffic.foreign_requests[place] += 1
            traffic.requests[place] += 1
        elif data and data[0] & _COMMAND == _ABORT:
            traffic.answered = True
        elif data and data[0] & _COMMAND in _ANSWERS:
            traffic.answered = True
            if data[1:4] in traffic.requests:
                traffic.answers[data[1:4]] += 1


def _object_of(data: bytes) -> bytes:
    """Index and sub-index of a request that begins a transfer; no bytes for any other."""
    return data[1:4] if data and data[0] & _COMMAND in _INITIATES else b""


class SniffedBus:
    """A `Bus` around another one that reports every frame to a `BusSniffer`."""

    def __init__(self, bus: Bus, clock: Clock, sniffer: BusSniffer) -> None:
        self._bus = bus
        self._clock = clock
        self._sniffer = sniffer

    def send(self, frames: Sequence[Frame]) -> int:
        """As `Bus.send`."""
        self._record_sent(frames)
        return self._bus.send(frames)

    def send_urgent(self, frames: Sequence[Frame], deadline_ns: int, clock: Clock) -> int:
        """As `Bus.send_urgent`."""
        self._record_sent(frames)
        return self._bus.send_urgent(frames, deadline_ns, clock)

    def drain(self) -> list[Frame]:
        """As `Bus.drain`."""
        return self._record_received(self._bus.drain())

    def receive_until(self, deadline_ns: int, clock: Clock) -> list[Frame]:
        """As `Bus.receive_until`."""
        return self._record_received(self._bus.receive_until(deadline_ns, clock))

    def close(self) -> None:
        """As `Bus.close`."""
        self._bus.close()

    def _record_sent(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            self._sniffer.sent(frame)

    def _record_received(self, frames: list[Frame]) -> list[Frame]:
        now_ns = self._clock.now_ns()
        for frame in frames:
            self._sniffer.received(frame, now_ns)
        return frames
