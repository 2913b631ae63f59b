"""The bus of simulated time: a `Bus` whose wire and clock belong to `gaitd sim`.

Time passes only in a wait. Reading received frames is a wait of no length, so that frames of the
present instant are included.
"""

from collections.abc import Sequence
from typing import Final

from drives.canopen.bus import Clock, Frame
from drives.errors import BusError
from simtime.link import Link, LinkLostError

RETRY_NS: Final = 200_000
"""Pause between two tries of an urgent frame, as on a real bus."""


class SimulatedBus:
    """A `Bus` over a link."""

    def __init__(self, link: Link, channel: str) -> None:
        self._link, self._channel = link, channel
        self.foreign_count = 0
        """As `OpenedBus.foreign_count`: always 0, this bus carries no such frame."""

    def open(self) -> "SimulatedBus":
        """Connect to the simulation.

        Raises:
            BusError: nothing answers there.
        """
        try:
            self._link.open()
        except LinkLostError as error:
            raise BusError(self._channel, str(error)) from error
        return self

    def send(self, frames: Sequence[Frame]) -> int:
        """As `Bus.send`."""
        try:
            return self._link.send(frames)
        except LinkLostError as error:
            raise BusError(self._channel, str(error)) from error

    def send_urgent(self, frames: Sequence[Frame], deadline_ns: int, clock: Clock) -> int:
        """As `Bus.send_urgent`."""
        dropped = self.send(frames)
        while dropped and (now_ns := clock.now_ns()) < deadline_ns:
            self._wait(min(now_ns + RETRY_NS, deadline_ns), for_frame=False)
            dropped = self.send(frames[len(frames) - dropped :])
        return dropped

    def drain(self) -> list[Frame]:
        """As `Bus.drain`."""
        self._wait(self._link.now_ns(), for_frame=False)
        return self._link.take()

    def receive_until(self, deadline_ns: int, clock: Clock) -> list[Frame]:
        """As `Bus.receive_until`."""
        del clock
        self._wait(deadline_ns, for_frame=True)
        return self._link.take()

    def close(self) -> None:
        """Drop what was received; the connection stays, because the clock uses it."""
        self._link.take()

    def _wait(self, until_ns: int, *, for_frame: bool) -> None:
        try:
            self._link.check()
            self._link.wait(until_ns, for_frame=for_frame)
        except LinkLostError as error:
            raise BusError(self._channel, str(error)) from error
