"""The core as its records show it: the newest one, and whether more arrive.

That records arrive is the one check behind `alive` and `safety.valid`.
"""

import logging
from typing import Final, Protocol

from daemon.gateway.translate import Stamp, stamp_of
from daemon.ipc.record import CycleRecord, GatewayState
from daemon.ipc.transport import RingError, RingHeader

SILENCE_NS: Final = 200_000_000
"""Time without a record after which nothing reported by the core is valid any more."""


class CoreLink(Protocol):
    """The part of the channel to the core that the gateway needs: see `GatewayChannel`."""

    @property
    def header(self) -> RingHeader | None:
        """Return the header of the core's ring; None: none was found."""
        ...

    def records(self) -> list[CycleRecord]:
        """Records since the last call."""
        ...

    @property
    def starting(self) -> bool:
        """True while a core starts, and writes no records yet."""
        ...

    def take_unread(self) -> int:
        """Number of records that could not be read so far, if it is to be reported now; or 0."""
        ...

    def send(self, gateway_state: GatewayState, /) -> bool:
        """Send a state to the core; False if it could not be sent."""
        ...


class CoreView:
    """The newest record of the core, and its presence."""

    def __init__(self, link: CoreLink) -> None:
        self.link = link
        self.boot_id = ""
        self.newest: CycleRecord | None = None
        """The newest record, also of a core that is silent now."""
        self.is_present = False
        self._last_ns = 0
        self._ring_error = ""
        self._log = logging.getLogger("gaitd.gateway")

    @property
    def record(self) -> CycleRecord | None:
        """The newest record; None if no records arrive."""
        return self.newest if self.is_present else None

    @property
    def stamp(self) -> Stamp:
        """The stamp of messages made from the newest record."""
        return stamp_of(self.boot_id, self.newest) if self.newest else Stamp()

    def read(self) -> list[CycleRecord]:
        """Records since the last call; none if the ring cannot be read."""
        try:
            records = self.link.records()
        except RingError as error:
            # Logged once: the file stays as it is until another core writes it.
            if str(error) != self._ring_error:
                self._ring_error = str(error)
                self._log.error("%s", error)
            return []
        self._ring_error = ""
        return records

    def records_arrive(self, now_ns: int) -> None:
        """Note that there are new records."""
        self.is_present, self._last_ns = True, now_ns

    def falls_silent(self, now_ns: int) -> bool:
        """Check for silence; true once per silence, when it begins."""
        silent = self.is_present and now_ns - self._last_ns > SILENCE_NS
        if silent:
            self.is_present = False
        return silent
