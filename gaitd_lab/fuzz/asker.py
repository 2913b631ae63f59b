"""The gateway of a random session: it asks, falls silent, dies, and outlives cores."""

from collections.abc import Callable
from typing import Final

from daemon.ipc.record import CycleRecord, GatewayState, Request
from gaitd_lab.lockstep_gateway import Gateway

RECORDS_KEPT: Final = 200


class Asker(Gateway):
    """The lock-step gateway, kept short; it may hang, be started anew, and outlive a core.

    To a core that it has not heard yet it says what it said to the one before.
    """

    def __init__(self, on_level: Callable[[GatewayState], None]) -> None:
        super().__init__()
        self._on_level = on_level
        self._fresh: list[CycleRecord] = []
        self._next_boot_id = self.core_boot_id

    def expect(self, boot_id: str) -> None:
        """A core has started: its first record makes them known to each other."""
        self._next_boot_id = boot_id
        self._fresh.clear()  # the last words of the core before are no records of this one

    def publish(self, record: CycleRecord) -> None:
        """Keep the newest records only."""
        if self.core_boot_id != self._next_boot_id:
            self._meet(record)
        super().publish(record)
        self._fresh.append(record)
        if len(self.records) > 2 * RECORDS_KEPT:
            del self.records[:-RECORDS_KEPT]

    def fresh(self) -> list[CycleRecord]:
        """Those that nobody has looked at yet."""
        fresh, self._fresh = self._fresh, []
        return fresh

    def levels(self) -> list[GatewayState]:
        """What the core hears now, and the watch with it."""
        levels = super().levels()
        if self.core_boot_id == self._next_boot_id:
            for level in levels:
                self._on_level(level)
        return levels

    def _meet(self, record: CycleRecord) -> None:
        """Another core: nothing that was asked of the one before is asked of this one."""
        self.core_boot_id = self._next_boot_id
        self._request = Request(record.request.id)
        self._setpoints, self.lease, self.controller = (), 0, None

    @property
    def number(self) -> int:
        """Of the newest request."""
        return self._request.id

    def begin_anew(self) -> None:
        """Another gateway process: it knows the records, and the time its levels count on from."""
        self._setpoints = ()
        self.lease, self.controller = 0, None
        newest = self.records[-1].request.id if self.records else 0
        self._request = Request(max(newest, self._request.id))
        self._stop_count = self.records[-1].stop_count if self.records else 0
