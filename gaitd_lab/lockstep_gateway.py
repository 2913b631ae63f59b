"""The gateway side of the IPC channel in a lock-step run: stores records, sends requests."""

import errno
from collections.abc import Callable
from typing import Final

from gaitd_names import RequestKind, Role

from daemon.ipc.record import (
    CycleRecord,
    GatewayState,
    ModeRequest,
    Request,
    RequestResult,
    Setpoint,
)
from daemon.ipc.report import Event

BOOT_ID: Final = "lockstep"

Controller = Callable[[CycleRecord], tuple[Setpoint, ...]]
"""A scripted controller: receives a record, returns the setpoints that the gateway forwards."""


Change = Callable[[list[GatewayState]], list[GatewayState]]


class Gateway:
    """The gateway side of the IPC channel: stores every record, and sends requests of a script."""

    def __init__(self, on_record: Callable[[CycleRecord], None] | None = None) -> None:
        self.records: list[CycleRecord] = []
        self.core_boot_id = BOOT_ID
        """Boot id of the connected core."""
        self.silent = False
        """True for a gateway that hangs: it sends no state."""
        self.change: Change | None = None
        """Alters the gateway states of a turn before the core receives them."""
        self.ring_is_full = False
        """True if the ring refuses each record."""
        self.lease = 0
        """The present lease number in the gateway state; 0: none."""
        self.controller: Controller | None = None
        """Answers each record with the newest setpoint of each leg."""
        self._setpoints: tuple[Setpoint, ...] = ()
        self._on_record = on_record
        self._lease_count = 0
        self._seq = 0
        self._stop_count = 0
        self._request = Request()

    # --- interface of the loop ----------------------------------------------------------------

    def publish(self, record: CycleRecord) -> None:
        """Store a record, and pass it to the script.

        Raises:
            OSError: the ring cannot be written.
        """
        if self.ring_is_full:
            raise OSError(errno.ENOSPC, "no space left for the ring")
        self.records.append(record)
        if self._on_record is not None:
            self._on_record(record)
        if self.controller is not None:
            self._setpoints = self.controller(record)

    def receive(self) -> list[GatewayState]:
        """Return one gateway state for each turn, made when the newest record had been read."""
        states: list[GatewayState] = []
        if not self.silent and self.records:
            self._seq += 1
            cycle = self.records[-1].cycle
            stop_count, request = self._stop_count, self._request
            sent = self._seq, cycle, stop_count, request, self._setpoints, self.lease
            states = [GatewayState(self.core_boot_id, *sent, Role.UNRESTRICTED)]
        return states if self.change is None else self.change(states)

    def take_notices(self) -> list[Event]:
        """Return no notices: this gateway exchanges objects, so no bytes can be refused."""
        return []

    # --- interface of the script --------------------------------------------------------------

    def grant_lease(self, controller: Controller) -> int:
        """Give a new lease to a controller that answers each record from now on.

        Returns: the lease, which its setpoints must carry.
        """
        self.lease = self._lease_count = self._lease_count + 1
        self.controller = controller
        return self.lease

    def end_lease(self) -> None:
        """End the lease; its controller continues to send setpoints."""
        self.lease = 0

    def request(self, kind: RequestKind, wanted: ModeRequest | None = None) -> None:
        """Send a request once; the answer comes in the records."""
        cycle = self.records[-1].cycle if self.records else 0
        self._request = Request(
            self._request.id + 1, kind, cycle, wanted or ModeRequest(), Role.UNRESTRICTED
        )

    def stop(self) -> None:
        """Request a stop, in any state."""
        self._stop_count += 1

    def outcome(self) -> RequestResult:
        """Return the outcome of the newest request."""
        result = self.records[-1].request
        return result if result.id == self._request.id else RequestResult(self._request.id)
