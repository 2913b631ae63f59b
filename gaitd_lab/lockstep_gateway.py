"""The other end of the seam in a lock-step run: keeps every record, says what a script wants."""

from collections.abc import Callable
from typing import Final

from daemon.ipc.record import (
    CycleRecord,
    GatewayState,
    ModeRequest,
    Request,
    RequestKind,
    RequestResult,
    Setpoint,
)

BOOT_ID: Final = "lockstep"

Controller = Callable[[CycleRecord], tuple[Setpoint, ...]]
"""A controller in the script's hand: a record in, the setpoints that the gateway forwards out."""


class Gateway:
    """The other end of the seam: hears every record, and asks when a script tells it to."""

    def __init__(self, on_record: Callable[[CycleRecord], None] | None = None) -> None:
        self.records: list[CycleRecord] = []
        self.core_boot_id = BOOT_ID
        """Of the core that it talks to."""
        self.silent = False
        """A gateway that hangs: no levels any more."""
        self.lease = 0
        """That is held, as the gateway tells it; 0: none."""
        self.controller: Controller | None = None
        """Answers each record with the newest setpoint of each leg."""
        self._setpoints: tuple[Setpoint, ...] = ()
        self._on_record = on_record
        self._lease_count = 0
        self._seq = 0
        self._stop_count = 0
        self._request = Request()

    # --- the loop's side --------------------------------------------------------------------

    def publish(self, record: CycleRecord) -> None:
        """Keep it, and let the script look at it."""
        self.records.append(record)
        if self._on_record is not None:
            self._on_record(record)
        if self.controller is not None:
            self._setpoints = self.controller(record)

    def levels(self) -> list[GatewayState]:
        """One level for each turn, made when the newest record had been read."""
        if self.silent or not self.records:
            return []
        self._seq += 1
        cycle = self.records[-1].cycle
        stop_count, request = self._stop_count, self._request
        told = self._seq, cycle, stop_count, request, self._setpoints, self.lease
        return [GatewayState(self.core_boot_id, *told)]

    def take_notices(self) -> list[str]:
        """Nothing is refused here: there are no bytes."""
        return []

    # --- the script's side ------------------------------------------------------------------

    def lend(self, controller: Controller) -> int:
        """Give a new lease to a controller that answers each record from now on.

        Returns: the lease, which its setpoints must carry.
        """
        self.lease = self._lease_count = self._lease_count + 1
        self.controller = controller
        return self.lease

    def end_lease(self) -> None:
        """Nobody holds it any more; whoever sends setpoints goes on doing so."""
        self.lease = 0

    def ask(self, kind: RequestKind, wanted: ModeRequest | None = None) -> None:
        """Ask for something once; the answer comes in the records."""
        cycle = self.records[-1].cycle if self.records else 0
        self._request = Request(self._request.id + 1, kind, cycle, wanted or ModeRequest())

    def stop(self) -> None:
        """Stop, whatever else is going on."""
        self._stop_count += 1

    def outcome(self) -> RequestResult:
        """What became of the newest request."""
        result = self.records[-1].request
        return result if result.id == self._request.id else RequestResult(self._request.id)
