"""The `DrivePort` over a `Bus`: canopen's SDO client, without canopen's threads.

canopen's client waits for a queue that a Notifier thread fills. Here the waiting client reads the
bus itself and passes each frame on, so bring-up needs no thread, and runs the same on a bus in
memory whose time is simulated. Used of canopen 2.4.1: `SdoClient`, abort texts.
Workarounds, with their place in canopen:

- A late reply to an earlier request can satisfy the next one (client.py compares the object only
  in upload): replies of another kind, or for another object, are dropped.
- A timeout sends an abort for 0000h:00; here it names the object of the transfer.
- A segmented upload may end before or after the announced length: then there is no value.
- The default retry would send a request twice; a drive that does not answer once is silent.
- A segmented transfer has no end while the server goes on: here each transfer has a deadline.

A node has one SDO channel with one transfer at a time. A repeated reply to the same request is
counted: two nodes may be answering.

Another client may use a node's server at the same time: `gaitd scan` and `gaitd drive` beside a
service, which reads temperatures in its cycle. A reply to its request is no repeat, and an upload
that meets its request, and has no reply, is tried once more: a server may drop one of the two.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final, TypeVar

import canopen
from canopen.sdo.client import ReadableStream, SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from drives.bringup.port import NodeTraffic
from drives.canopen.bus import Bus, Clock, Frame
from drives.canopen.bus_state import BusCondition, BusMonitor
from drives.canopen.emcy import EMERGENCY_ID
from drives.canopen.nmt import HEARTBEAT_ID, SYNC_ID, HeartbeatWatch, SyncProducer
from drives.canopen.sdo import SDO_ANSWER_ID, SDO_REQUEST_ID
from drives.errors import BusError, BusOff, SdoAborted, SdoGarbled, SdoTimeout

SDO_TIMEOUT_NS: Final = 300_000_000
"""Limit for each reply."""
SDO_TRANSFER_NS: Final = 1_000_000_000
"""Limit for a whole transfer, however many segments the server uses."""
SLICE_NS: Final = 10_000_000
"""Longest single wait for a reply."""
SEND_TIMEOUT_NS: Final = 20_000_000
"""How long a full transmit queue may refuse a bring-up frame."""

_SERVICE: Final = 0x780
_NODE: Final = 0x07F
_TPDO_SERVICES: Final = frozenset((0x180, 0x280, 0x380, 0x480))

_SDO_BYTES: Final = 8
_COMMAND: Final = 0xE0
_ABORT: Final = 0x80
_REPLY_TO: Final = {0x20: 0x60, 0x40: 0x40, 0x00: 0x20, 0x60: 0x00}
"""Command specifiers (CiA 301 7.2.4.3): download, upload; download segment, upload segment."""
_WITH_OBJECT: Final = frozenset((0x60, 0x40, _ABORT))
"""Replies whose bytes 1..3 name the object; the same holds for their requests."""


_Result = TypeVar("_Result")


class Configurator:
    """SDO, NMT and reception for bring-up; owns nothing but its view of the traffic."""

    def __init__(
        self,
        bus: Bus,
        clock: Clock,
        sdo_timeout_ns: int = SDO_TIMEOUT_NS,
        sync: SyncProducer | None = None,
        bus_state: BusMonitor | None = None,
        meanwhile: Callable[[], None] | None = None,
    ) -> None:
        """Use the `sync` and `bus_state` of the owner of the bus, who outlives this object.

        `meanwhile` is called every 10 ms while waiting for a reply.
        """
        self._bus = bus
        self._clock = clock
        self._sdo_timeout_ns = sdo_timeout_ns
        self.sync = sync or SyncProducer()
        self.bus_state = bus_state or BusMonitor()
        self._meanwhile = meanwhile
        self.foreign_sync_count = 0
        self._clients: dict[int, _Client] = {}
        self._traffic: dict[int, NodeTraffic] = {}
        self._watches: dict[int, HeartbeatWatch] = {}

    def now_ns(self) -> int:
        """As `DrivePort.now_ns`."""
        return self._clock.now_ns()

    def send(self, frames: Sequence[Frame]) -> None:
        """As `DrivePort.send`."""
        self._refuse_bus_off()
        deadline_ns = self._clock.now_ns() + SEND_TIMEOUT_NS
        left = self._bus.send_urgent(frames, deadline_ns, self._clock)
        if left:
            what = f"the transmit queue stays full: {left} frames of bring-up did not leave"
            alone = "; no other node is on the bus" if self.bus_state.alone else ""
            raise BusError("in bring-up", what + alone)

    def wait(self, until_ns: int) -> None:
        """As `DrivePort.wait`."""
        for frame in self._bus.receive_until(until_ns, self._clock):
            self._receive(frame)
        self._refuse_bus_off()

    def traffic(self, node_id: int) -> NodeTraffic:
        """As `DrivePort.traffic`."""
        return self._traffic.setdefault(node_id, NodeTraffic())

    def read(self, node_id: int, index: int, sub: int) -> bytes:
        """As `DrivePort.read`."""

        def upload(client: _Client) -> bytes:
            return client.upload(index, sub)

        try:
            return self._transfer(node_id, index, sub, upload)
        except SdoTimeout:
            if not self._client(node_id).met_another:
                raise
            return self._transfer(node_id, index, sub, upload)

    def write(self, node_id: int, index: int, sub: int, data: bytes) -> None:
        """As `DrivePort.write`."""
        self._transfer(node_id, index, sub, lambda client: client.download(index, sub, data))

    def _transfer(
        self, node_id: int, index: int, sub: int, run: "Callable[[_Client], _Result]"
    ) -> _Result:
        client = self._client(node_id)
        client.timed_out = False
        client.met_another = client.others.total() > 0
        client.deadline_ns = self._clock.now_ns() + max(SDO_TRANSFER_NS, self._sdo_timeout_ns)
        try:
            return run(client)
        except SdoAbortedError as abort:
            text = SdoAbortedError.CODES.get(abort.code, "unknown abort code")
            raise SdoAborted(index, sub, abort.code, text) from abort
        except SdoCommunicationError as error:
            if client.timed_out:
                raise SdoTimeout(index, sub, self._sdo_timeout_ns) from error
            raise SdoGarbled(index, sub, str(error)) from error

    def _client(self, node_id: int) -> "_Client":
        client = self._clients.get(node_id)
        if client is None:
            client = self._clients[node_id] = _Client(node_id, self._send_one, self._await_reply)
        return client

    def _await_reply(self, client: "_Client") -> None:
        deadline_ns = min(self._clock.now_ns() + self._sdo_timeout_ns, client.deadline_ns)
        while client.responses.empty():
            if self._clock.now_ns() >= deadline_ns:
                client.timed_out = True
                return
            self.wait(min(deadline_ns, self._clock.now_ns() + SLICE_NS))
            if self._meanwhile is not None:
                self._meanwhile()

    def _send_one(self, frame: Frame) -> None:
        self.send((frame,))

    def _receive(self, frame: Frame) -> None:
        if frame.is_error:
            self.bus_state.feed(frame)
            return
        self.bus_state.frame_received()
        self.bus_state.assume_restarted()
        service, node_id = frame.can_id & _SERVICE, frame.can_id & _NODE
        if service == SDO_ANSWER_ID:
            if node_id in self._clients:
                client = self._clients[node_id]
                client.receive(frame.data)
                self.traffic(node_id).sdo_repeat_count = client.repeat_count
        elif service == SDO_REQUEST_ID and node_id:
            self._client(node_id).receive_foreign_request(frame.data)
        elif service == HEARTBEAT_ID:
            self._receive_heartbeat(node_id, frame.data)
        elif service == EMERGENCY_ID and node_id:
            self.traffic(node_id).emergencies.append(frame.data)
        elif frame.can_id == SYNC_ID:
            self.foreign_sync_count += 1
        elif service in _TPDO_SERVICES:
            traffic = self.traffic(node_id)
            traffic.pdo_count[frame.can_id] = traffic.pdo_count.get(frame.can_id, 0) + 1
            traffic.pdo_data[frame.can_id] = frame.data

    def _refuse_bus_off(self) -> None:
        if self.bus_state.condition is BusCondition.OFF:
            raise BusOff("in bring-up", "the controller is bus-off: wiring, bit rate?")

    def _receive_heartbeat(self, node_id: int, data: bytes) -> None:
        watch = self._watches.setdefault(node_id, HeartbeatWatch())
        traffic = self.traffic(node_id)
        strange_count, boot_up_count = watch.strange_count, watch.boot_up_count
        watch.feed(data, self._clock.now_ns())
        traffic.boot_up_count = watch.boot_up_count
        traffic.nmt_state = watch.state
        if watch.strange_count == strange_count and watch.boot_up_count == boot_up_count:
            traffic.heartbeat_count += 1


class _Client(SdoClient):
    """One node's SDO client, which reads the bus while it waits."""

    deadline_ns: int
    """End of the transfer, set for each one."""
    timed_out: bool
    """The transfer had no reply in time, set for each one."""
    met_another: bool
    """A request of another client was unanswered during the transfer, set for each one."""
    _object: bytes
    """Index and sub-index of the transfer, as in its frames; its first request names it."""

    def __init__(
        self,
        node_id: int,
        send: Callable[[Frame], None],
        await_reply: "Callable[[_Client], None]",
    ) -> None:
        empty = canopen.ObjectDictionary()
        # Its second argument is for canopen's own reception, which is not used.
        super().__init__(SDO_REQUEST_ID + node_id, 0, empty)
        # The reply was received, or the wait is over, before the queue is read.
        self.RESPONSE_TIMEOUT = 0
        self._send = send
        self._await_reply = await_reply
        self._reply: int | None = None
        """Command specifier of the reply to the last request; None: there is none to come."""
        self._given: bytes | None = None
        """Identifies the reply that ended the last request."""
        self.repeat_count = 0
        """Replies that repeat the last accepted one."""
        self.others = Counter[bytes]()
        """Requests of other clients that have no reply yet, by object; segments under no bytes."""

    def receive_foreign_request(self, request: bytes) -> None:
        """Take a request of another client to this node."""
        reply = _REPLY_TO.get(request[0] & _COMMAND) if request else None
        if reply is not None:
            self.others[request[1:4] if reply in _WITH_OBJECT else b""] += 1
            self.met_another = True

    def receive(self, reply: bytes) -> None:
        """Take a reply, unless it belongs to another request."""
        if self._belongs(reply):
            self._reply = None
            self._given = _identity(reply)
            self.responses.put(reply)
            return
        of = _identity(reply)[1:]
        if self.others[of]:
            self.others[of] -= 1
        else:
            self.repeat_count += _identity(reply) == self._given

    def upload(self, index: int, subindex: int) -> bytes:
        stream = ReadableStream(self, index, subindex)
        data = bytes(stream.read())
        if stream.size not in (None, len(data)):
            raise SdoCommunicationError(f"{stream.size} bytes announced, {len(data)} received")
        return data

    def request_response(self, sdo_request: bytes) -> bytes:
        request = bytes(sdo_request)
        self._reply = _REPLY_TO[request[0] & _COMMAND]
        if self._reply in _WITH_OBJECT:
            self._object = request[1:4]
        return super().request_response(sdo_request)

    def read_response(self) -> bytes:
        self._await_reply(self)
        return super().read_response()

    def send_request(self, request: bytes) -> None:
        self._send(Frame(self.rx_cobid, bytes(request)))

    def abort(self, abort_code: int = 0x0800_0000) -> None:
        self.send_request(bytes((_ABORT,)) + self._object + abort_code.to_bytes(4, "little"))

    def _belongs(self, data: bytes) -> bool:
        if self._reply is None or len(data) != _SDO_BYTES:
            return False
        command = data[0] & _COMMAND
        if command not in (self._reply, _ABORT):
            return False
        return command not in _WITH_OBJECT or data[1:4] == self._object


def _identity(reply: bytes) -> bytes:
    """Command and object, or command and toggle bit: equal in the replies of two nodes."""
    return reply[:4] if reply and reply[0] & _COMMAND in _WITH_OBJECT else reply[:1]
