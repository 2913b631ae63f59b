"""The gateway of a random session: it sends requests, stalls, dies, and outlives cores."""

from collections.abc import Callable
from typing import Final

from daemon.ipc.record import CycleRecord, GatewayState, Request
from gaitd_lab.lockstep_gateway import Gateway

RECORDS_KEPT: Final = 200


class RestartableGateway(Gateway):
    """The lock-step gateway with a short history; it may hang, be restarted, and outlive a core.

    A core from which it has no record yet receives the gateway state of the previous core.
    """

    def __init__(self, on_state: Callable[[GatewayState], None]) -> None:
        super().__init__()
        self._on_state = on_state
        self._fresh: list[CycleRecord] = []
        self._next_boot_id = self.core_boot_id

    def expect(self, boot_id: str) -> None:
        """Prepare for a new core, which is known from its first record on."""
        self._next_boot_id = boot_id
        self._fresh.clear()  # the last records of the previous core do not belong to this one

    def publish(self, record: CycleRecord) -> None:
        """Store the newest records only."""
        if self.core_boot_id != self._next_boot_id:
            self._begin_core(record)
        super().publish(record)
        self._fresh.append(record)
        if len(self.records) > 2 * RECORDS_KEPT:
            del self.records[:-RECORDS_KEPT]

    def fresh(self) -> list[CycleRecord]:
        """Return the records that have not been read yet."""
        fresh, self._fresh = self._fresh, []
        return fresh

    def receive(self) -> list[GatewayState]:
        """Return the gateway states that the core, and the checks, receive now."""
        gateway_states = super().receive()
        if self.core_boot_id == self._next_boot_id:
            for gateway_state in gateway_states:
                self._on_state(gateway_state)
        return gateway_states

    def _begin_core(self, record: CycleRecord) -> None:
        """Switch to another core: requests to the previous one are dropped."""
        self.core_boot_id = self._next_boot_id
        self._request = Request(record.request.id)
        self._setpoints, self.lease, self.controller = (), 0, None

    @property
    def number(self) -> int:
        """Number of the newest request."""
        return self._request.id

    def restart(self) -> None:
        """Restart the gateway process: it keeps the records, and the time base of its states."""
        self._setpoints = ()
        self.lease, self.controller = 0, None
        newest = self.records[-1].request.id if self.records else 0
        self._request = Request(max(newest, self._request.id))
        self._stop_count = self.records[-1].stop_count if self.records else 0
