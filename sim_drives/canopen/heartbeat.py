"""Error control of a slave: heartbeat producer 1017h and consumer 1016h (CiA 301 7.2.8.2.2).

Rules:
1. The producer sends its NMT state every 1017h milliseconds, from the boot-up message on; 0 is off.
2. 1016h: bits 16 to 22 name a node, bits 0 to 15 the time in ms; 0 in either switches the entry
   off. Two entries of the same node: 06040043; a higher bit: 06090030.
3. A node is watched from its first heartbeat; a boot-up message does not count as one. A missed
   heartbeat time is one loss; the next heartbeat, or rewriting the entry, ends it and restarts the
   watch.
"""

from collections.abc import Callable
from typing import Final

from drives.canopen.frame import Frame
from sim_drives.canopen.aborts import AbortCode, SdoAbortError
from sim_drives.canopen.context import NodeContext
from sim_drives.canopen.nmt import NmtState
from sim_drives.canopen.objects import Object
from sim_drives.canopen.timers import MILLISECOND

HEARTBEAT_ID: Final = 0x700
HEARTBEAT_IDS: Final = range(0x701, 0x780)


class HeartbeatProducer:
    """Sends the NMT state byte periodically."""

    def __init__(self, node_id: int, context: NodeContext, state: Callable[[], NmtState]) -> None:
        self._can_id = HEARTBEAT_ID + node_id
        self._dictionary, self._line, self._timers = context
        self._state = state
        self._dictionary.watch(Object.HEARTBEAT_PRODUCER, lambda _: self.restart())

    def boot_up(self) -> None:
        """Send the boot-up message."""
        self._line.send(Frame(self._can_id, bytes((NmtState.INITIALISING,))))
        self.restart()

    def stop(self) -> None:
        """Stop sending until the next boot-up."""
        self._timers.cancel(Object.HEARTBEAT_PRODUCER)

    def restart(self) -> None:
        """Start a new period of 1017h, or none if it is 0."""
        period_ms = self._dictionary.value(Object.HEARTBEAT_PRODUCER)
        if period_ms:
            at_ns = self._line.now_ns + period_ms * MILLISECOND
            self._timers.start(Object.HEARTBEAT_PRODUCER, at_ns, self._send)
        else:
            self._timers.cancel(Object.HEARTBEAT_PRODUCER)

    def _send(self) -> None:
        self._line.send(Frame(self._can_id, bytes((self._state(),))))
        self.restart()


class HeartbeatConsumer:
    """Watches the nodes that 1016h lists."""

    def __init__(self, context: NodeContext, report: Callable[[bool], None]) -> None:
        """`report` receives whether a watched node is lost."""
        self._dictionary, self._line, self._timers = context
        self._report = report
        self._lost: set[int] = set()
        self._slots = range(1, self._dictionary.value(Object.HEARTBEAT_CONSUMER, 0) + 1)
        self._dictionary.guard(Object.HEARTBEAT_CONSUMER, self._check)
        self._dictionary.watch(Object.HEARTBEAT_CONSUMER, self._reset)

    def restart(self) -> None:
        """Clear all watches: each node is watched again from its first heartbeat."""
        for slot in self._slots:
            self._reset(slot)

    def received(self, node_id: int, state: int) -> None:
        """Process a heartbeat or a boot-up message of another node."""
        if state == NmtState.INITIALISING:
            return
        for slot in self._slots:
            watched_id, timeout_ns = self._slot(slot)
            if watched_id == node_id and timeout_ns:
                self._watch(slot, timeout_ns)

    def _reset(self, slot: int) -> None:
        self._timers.cancel((Object.HEARTBEAT_CONSUMER, slot))
        self._restored(slot)

    def _restored(self, slot: int) -> None:
        if slot in self._lost:
            self._lost.remove(slot)
            if not self._lost:
                self._report(False)

    def _watch(self, slot: int, timeout_ns: int) -> None:
        self._restored(slot)
        at_ns = self._line.now_ns + timeout_ns
        self._timers.start((Object.HEARTBEAT_CONSUMER, slot), at_ns, lambda: self._lose(slot))

    def _lose(self, slot: int) -> None:
        self._lost.add(slot)
        self._report(True)

    def _slot(self, slot: int) -> tuple[int, int]:
        value = self._dictionary.value(Object.HEARTBEAT_CONSUMER, slot)
        return value >> 16 & 0x7F, (value & 0xFFFF) * MILLISECOND

    def _check(self, subindex: int, value: int) -> None:
        if value >> 23:
            raise SdoAbortError(AbortCode.RANGE)
        node_id = value >> 16
        others = (slot for slot in self._slots if slot != subindex)
        if node_id and value & 0xFFFF and node_id in {self._slot(slot)[0] for slot in others}:
            raise SdoAbortError(AbortCode.PARAMETER_INCOMPATIBLE)
