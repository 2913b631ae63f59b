"""Messages of each leg: the estimate is published at once, the other messages later in the turn.

A controller waits for the estimate, where every microsecond counts; the others are not urgent.
"""

from collections.abc import Sequence
from typing import Final

from daemon.gateway import strides, translate
from daemon.gateway.health import HealthWindow
from daemon.gateway.outlet import Outlet
from daemon.gateway.translate import View
from daemon.gateway.tremor import LegTremor
from daemon.ipc.record import CycleRecord
from daemon.system.clock import AgeClock

YOUNG_RECORD_COUNT: Final = 20
"""Records older than this, in cycles, are not published, so that after a stall old estimates do not
appear as current ones."""
_LATER_MESSAGES: Final = (("activity", translate.activity), ("friction", translate.friction))


class LegMessages:
    """Publishes the messages of all legs of a core."""

    def __init__(self, outlet: Outlet, clock: AgeClock, health: HealthWindow) -> None:
        self._outlet, self._clock, self._health = outlet, clock, health
        self._tremors: dict[str, LegTremor] = {}
        """By leg, of one core."""
        self._core_boot_id = ""
        self._views: list[tuple[View, LegTremor]] = []
        """Legs whose estimate has been published and whose other messages have not."""
        self._published: list[tuple[View, LegTremor]] = []
        """Legs whose messages have all been published."""

    def publish_estimates(
        self, records: Sequence[CycleRecord], core_boot_id: str, now_ns: int
    ) -> None:
        """Publish the estimates of new records, oldest first."""
        if core_boot_id != self._core_boot_id:
            self._core_boot_id, self._tremors = core_boot_id, {}
        young = [r for r in records if records[-1].seq - r.seq < YOUNG_RECORD_COUNT]
        self._health.counters.record_skipped_count += len(records) - len(young)
        for record in young:
            stamp = translate.stamp_of(core_boot_id, record)
            for leg in record.legs:
                tremor = self._tremors.setdefault(leg.name, LegTremor())
                view = translate.view_of(leg, record, stamp, tremor.now)
                self._put_estimate(view, tremor, now_ns)

    def publish_others(self) -> None:
        """Publish the other messages of the records whose estimates have been published."""
        views, self._views = self._views, []
        for view, tremor in views:
            for name, make in _LATER_MESSAGES:
                parts = (view.leg.name, name)
                self._outlet.put(make(view, self._outlet.next_seq(*parts)), *parts)
            if view.leg.stride is not None:
                parts = (view.leg.name, "stride")
                message = strides.stride(
                    view.leg.stride, view, self._outlet.next_seq(*parts), tremor.end_stride()
                )
                self._outlet.put(message, *parts)
        self._published += views

    def follow_tremors(self) -> None:
        """Add what has been published to the tremors, for the next messages: nothing waits."""
        views, self._published = self._published, []
        for view, tremor in views:
            tremor.add(view.common)

    def _put_estimate(self, view: View, tremor: LegTremor, now_ns: int) -> None:
        parts = (view.leg.name, "estimate")
        message = translate.estimate(view, self._outlet.next_seq(*parts))
        made_ns = self._clock.now_ns()
        self._outlet.put(message, *parts)
        if not self._views:
            self._health.add_estimate(made_ns - now_ns)
        self._views.append((view, tremor))
