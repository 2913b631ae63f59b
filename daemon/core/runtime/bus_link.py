"""The CAN bus of the loop: counters and state that persist when the interface is closed.

Rules:
1.  Process data (SYNC, heartbeat, targets) are sent at once or dropped and counted: they are
    worthless in the next cycle. Frames that stop a drive are retried until their deadline.
2.  While the controller is bus-off no frame is sent: the drives would get a burst of stale frames
    after its restart. Receiving goes on, so that the restart is detected.
3.  Received SYNC frames and heartbeats with the master's node id come from another master: they are
    counted and published.
"""

from collections.abc import Callable, Sequence
from typing import Final

from gaitd_names import EventCode

from daemon.core.runtime.bus_load import LoadMeter
from daemon.ipc.record import BusRecord
from daemon.ipc.report import Event
from daemon.system.clock import Clock
from drives.bringup.configurator import Configurator
from drives.canopen.bus import Bus, Frame
from drives.canopen.bus_state import BusCondition, BusMonitor, BusNotice
from drives.canopen.nmt import HEARTBEAT_ID, SYNC_ID, SyncProducer

_EVENTS: Final = {
    BusNotice.ACTIVE: EventCode.CAN_ACTIVE,
    BusNotice.WARNING: EventCode.CAN_WARNING,
    BusNotice.PASSIVE: EventCode.CAN_PASSIVE,
    BusNotice.OFF: EventCode.CAN_OFF,
    BusNotice.ALONE: EventCode.CAN_ALONE,
    BusNotice.FRAMES_LOST: EventCode.CAN_FRAMES_LOST,
}


class Line:
    """A bus that can be opened and closed, with counters, SYNC producer and controller state."""

    def __init__(
        self,
        open_bus: Callable[[], Bus],
        clock: Clock,
        sync_overflow: int,
        master_node_id: int,
        bitrate_bit_per_s: int,
    ) -> None:
        self._open_bus = open_bus
        self._clock = clock
        self._bus: Bus | None = None
        self._master_ids = {SYNC_ID, HEARTBEAT_ID + master_node_id}
        self._foreign_reported_count = 0
        self.sync = SyncProducer(sync_overflow)
        self.bus_state = BusMonitor()
        self.load = LoadMeter(bitrate_bit_per_s)
        self.dropped_count = 0
        """Frames that were not sent because the transmit queue was full, or too late."""
        self.foreign_count = 0
        """Frames received from another master."""

    @property
    def is_open(self) -> bool:
        """True if the interface is open."""
        return self._bus is not None

    @property
    def is_off(self) -> bool:
        """True if the controller is bus-off."""
        return self.bus_state.condition is BusCondition.OFF

    def open(self) -> None:
        """Open the interface, unless it is open.

        Raises:
            BusError: there is no interface, or it does not work.
        """
        if self._bus is None:
            self._bus = self._open_bus()
            self.bus_state.begin()

    def close(self) -> None:
        """Close the interface."""
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def port(self, *, requested: bool, meanwhile: Callable[[], None]) -> Configurator:
        """The port of an open bus for bring-up; earlier errors of the controller are cleared."""
        self.bus_state.reset_history()
        if requested:
            self.bus_state.assume_restarted()
        return Configurator(
            self._existing(),
            self._clock,
            sync=self.sync,
            bus_state=self.bus_state,
            meanwhile=meanwhile,
        )

    # --- out --------------------------------------------------------------------------------

    def send(self, frames: Sequence[Frame]) -> None:
        """Send process data at once, or drop them.

        Raises:
            BusError: the bus is down.
        """
        if not self.is_off:
            dropped = self._existing().send(frames)
            self._count_sent(frames, dropped)

    def send_urgent(self, frames: Sequence[Frame], deadline_ns: int) -> bool:
        """Send urgent frames, with retries until the deadline; True if all were sent.

        Raises:
            BusError: the bus is down.
        """
        if self.is_off:
            return False
        left = self._existing().send_urgent(frames, deadline_ns, self._clock)
        self._count_sent(frames, left)
        return left == 0

    def drop(self, frames: Sequence[Frame]) -> None:
        """Count frames as dropped that would be sent too late."""
        self.dropped_count += len(frames)

    def _count_sent(self, frames: Sequence[Frame], dropped: int) -> None:
        self.dropped_count += dropped
        self.load.add(frames[: len(frames) - dropped])

    # --- in ---------------------------------------------------------------------------------

    def drain(self) -> list[Frame]:
        """As `Bus.drain`."""
        return self._count_foreign(self._existing().drain())

    def receive_until(self, deadline_ns: int) -> list[Frame]:
        """As `Bus.receive_until`."""
        return self._count_foreign(self._existing().receive_until(deadline_ns, self._clock))

    def take_notices(self) -> list[Event]:
        """Notices about the bus for the operator that have not been published yet."""
        state = self.bus_state
        lost = (state.overflow_count,)
        notices = [
            Event(_EVENTS[one], values=lost if one is BusNotice.FRAMES_LOST else ())
            for one in state.take_notices()
        ]
        if self.foreign_count > 10 * self._foreign_reported_count:
            self._foreign_reported_count = self.foreign_count
            foreign = Event(EventCode.CAN_FOREIGN_MASTER, values=(self.foreign_count,))
            notices.append(foreign)
        return notices

    def record(self, stray_count: int) -> BusRecord:
        """The counters of the bus for the record of a cycle."""
        state = self.bus_state
        return BusRecord(
            condition=state.condition.value,
            bus_off_count=state.bus_off_count,
            passive_count=state.passive_count,
            warning_count=state.warning_count,
            restart_count=state.restart_count,
            no_ack_count=state.no_ack_count,
            overflow_count=state.overflow_count,
            foreign_master_count=self.foreign_count,
            stray_count=stray_count,
            load_ratio=self.load.busy_ratio,
        )

    def _count_foreign(self, frames: list[Frame]) -> list[Frame]:
        self.load.add(frames)
        for frame in frames:
            if not frame.is_error:
                self.bus_state.frame_received()
                self.foreign_count += frame.can_id in self._master_ids
        return frames

    def _existing(self) -> Bus:
        if self._bus is None:
            raise RuntimeError("nothing can be sent or heard before the bus is open")
        return self._bus
