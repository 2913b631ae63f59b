"""TPDOs of one node (CiA 301 7.2.2): what is sent when.

Rules:
1. Type 1 to 240: at every n-th SYNC, with the values sampled at that SYNC; counted from the entry
   into operational, or from the SYNC whose counter is 1800h:06, which is then the first. Type 0: at
   the next SYNC after the mapped data has changed. A PDO that would leave after the synchronous
   window (1007h) is not sent.
2. Types 254 and 255: when the mapped data has changed, not sooner than the inhibit time (100 µs)
   after the last one; and when the event timer (ms) has run out since the last one, or since its
   objects were written; once on entering operational. Changes are detected at each SYNC and after
   whatever may have changed the drive's state.
"""

from collections.abc import Callable
from typing import NamedTuple

from drives.canopen.frame import Frame
from sim_drives.canopen.context import NodeContext
from sim_drives.canopen.pdo_channel import Channel, channels
from sim_drives.canopen.pdo_rules import PDO_COUNT, Direction
from sim_drives.canopen.sync import SyncConsumer


class _Kinds(NamedTuple):
    """The PDOs that exist, by what they do, until one of their objects is written."""

    synchronous: list[int]
    event_driven: list[tuple[int, Channel]]


class TransmitPdos:
    """All TPDOs of one node. `delays_ns(n)` returns the latency of the n TPDOs of one SYNC."""

    def __init__(
        self,
        context: NodeContext,
        sync: SyncConsumer,
        send: Callable[[int, Frame, int], None],
        delays_ns: Callable[[int], list[int]],
        *,
        locked: bool,
    ) -> None:
        dictionary, self._line, self._timers = context
        self._channels = channels(dictionary, Direction.TRANSMIT, self._written, locked=locked)
        self._sync = sync
        self._send = send
        """(PDO number from 1, frame, delay in ns)."""
        self._delays_ns = delays_ns
        self._operational = False
        self._syncs = [0] * PDO_COUNT
        self._counting = [True] * PDO_COUNT
        """True once the SYNC of 1800h:06 has come, for PDOs that wait for one."""
        self._sent: list[bytes | None] = [None] * PDO_COUNT
        self._free_at_ns = [0] * PDO_COUNT
        self._kinds: _Kinds | None = None

    def reset(self) -> None:
        """Drop all state after parameters have been restored."""
        self.leave_operational()
        for channel in self._channels:
            channel.invalidate()

    def enter_operational(self) -> None:
        """Start counting SYNCs and send the event-driven PDOs (rules 1 and 2)."""
        self._operational = True
        self._syncs = [0] * PDO_COUNT
        self._counting = [not channel.settings.sync_start for channel in self._channels]
        self._sent = [None] * PDO_COUNT
        self._free_at_ns = [0] * PDO_COUNT
        self.send_changes()

    def leave_operational(self) -> None:
        """Stop sending."""
        self._operational = False
        for slot in range(PDO_COUNT):
            self._written(slot)

    def _written(self, slot: int) -> None:
        self._kinds = None
        self._timers.cancel((Direction.TRANSMIT, "event", slot))
        self._timers.cancel((Direction.TRANSMIT, "inhibit", slot))
        if self._operational:
            self._start_event_timer(slot)

    @property
    def can_ids(self) -> set[int]:
        """CAN identifiers of the TPDOs."""
        return {can_id for one in self._channels if (can_id := one.can_id) is not None}

    @property
    def _present(self) -> "_Kinds":
        if self._kinds is None:
            used = [(slot, c) for slot, c in enumerate(self._channels) if c.settings.valid]
            self._kinds = _Kinds(
                [slot for slot, channel in used if channel.settings.synchronous],
                [(slot, channel) for slot, channel in used if not channel.settings.synchronous],
            )
        return self._kinds

    def sync(self) -> None:
        """Send the TPDOs of this SYNC; process values have been sampled."""
        due = [slot for slot in self._present.synchronous if self._due_at_sync(slot)]
        for slot, delay_ns in zip(due, self._delays_ns(len(due)), strict=True):
            if self._sync.within_window(delay_ns):
                self._transmit(slot, delay_ns)
        self.send_changes()

    def _due_at_sync(self, slot: int) -> bool:
        channel = self._channels[slot]
        settings = channel.settings
        if not self._counting[slot]:
            self._counting[slot] = self._sync.counter in (0, settings.sync_start)
        if not self._counting[slot]:
            return False
        if settings.type == 0:
            return channel.pack() != self._sent[slot]
        self._syncs[slot] += 1
        if self._syncs[slot] < settings.type:
            return False
        self._syncs[slot] = 0
        return True

    def send_changes(self) -> None:
        """Send event-driven PDOs whose data differs from what was sent last."""
        for slot, channel in self._present.event_driven:
            if channel.pack() != self._sent[slot]:
                self._send_event(slot)

    def _send_event(self, slot: int) -> None:
        if self._line.now_ns >= self._free_at_ns[slot]:
            self._transmit(slot, 0)
        else:
            name = (Direction.TRANSMIT, "inhibit", slot)
            self._timers.start(name, self._free_at_ns[slot], self.send_changes)

    def _transmit(self, slot: int, delay_ns: int) -> None:
        channel, now_ns = self._channels[slot], self._line.now_ns
        settings, data = channel.settings, channel.pack()
        self._sent[slot] = data
        self._free_at_ns[slot] = now_ns + settings.inhibit_ns
        self._send(channel.number, Frame(settings.can_id, data), delay_ns)
        self._start_event_timer(slot)

    def _start_event_timer(self, slot: int) -> None:
        settings = self._channels[slot].settings
        if settings.valid and not settings.synchronous and settings.event_timer_ns:
            at_ns = self._line.now_ns + settings.event_timer_ns
            name = (Direction.TRANSMIT, "event", slot)
            self._timers.start(name, at_ns, lambda: self._transmit(slot, 0))
