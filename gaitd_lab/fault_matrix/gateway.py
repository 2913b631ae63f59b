"""The other end of the seam, with what can go wrong with it and with where the core writes."""

import errno
from collections.abc import Callable

from daemon.ipc.record import CycleRecord, GatewayState
from gaitd_lab.lockstep_gateway import Gateway

Change = Callable[[list[GatewayState]], list[GatewayState]]


class TroubledGateway(Gateway):
    """A gateway whose levels can be changed on their way, and a ring that can refuse a record."""

    def __init__(self) -> None:
        super().__init__()
        self.change: Change | None = None
        """What becomes of the levels of a turn before the core hears them."""
        self.ring_is_full = False

    def levels(self) -> list[GatewayState]:
        """As the core hears them."""
        sent = super().levels()
        return sent if self.change is None else self.change(sent)

    def publish(self, record: CycleRecord) -> None:
        """Keep a record.

        Raises:
            OSError: the ring cannot be written.
        """
        if self.ring_is_full:
            raise OSError(errno.ENOSPC, "no space left for the ring")
        super().publish(record)
