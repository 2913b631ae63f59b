"""The gateway side of the IPC channel, with injectable faults of the gateway and of the ring."""

import errno
from collections.abc import Callable

from daemon.ipc.record import CycleRecord, GatewayState
from gaitd_lab.lockstep_gateway import Gateway

Change = Callable[[list[GatewayState]], list[GatewayState]]


class TroubledGateway(Gateway):
    """A gateway whose states can be altered in transit, and a ring that can refuse a record."""

    def __init__(self) -> None:
        super().__init__()
        self.change: Change | None = None
        """Alters the gateway states of a turn before the core receives them."""
        self.ring_is_full = False

    def levels(self) -> list[GatewayState]:
        """Return the gateway states as the core receives them."""
        sent = super().levels()
        return sent if self.change is None else self.change(sent)

    def publish(self, record: CycleRecord) -> None:
        """Store a record.

        Raises:
            OSError: the ring cannot be written.
        """
        if self.ring_is_full:
            raise OSError(errno.ENOSPC, "no space left for the ring")
        super().publish(record)
