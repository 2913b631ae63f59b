"""Messages of the machine as a whole: each of its drives, and `safety`."""

from collections.abc import Iterable
from typing import Any, Final

import msgspec
from gaitd_client import wire
from gaitd_names import ProgressCode

from daemon.gateway import translate
from daemon.gateway.core_view import CoreView
from daemon.gateway.emergencies import EmergencyHistory
from daemon.gateway.lease import LeaseManager
from daemon.gateway.outlet import Outlet
from daemon.ipc.record import CycleRecord, DriveRecord

DRIVES_PERIOD_NS: Final = 100_000_000


class MachineMessages:
    """Publishes drives and safety when they are due, and makes them for an answer."""

    def __init__(self, outlet: Outlet, core: CoreView, leases: LeaseManager) -> None:
        self._outlet, self._core, self._leases = outlet, core, leases
        self._emergencies = EmergencyHistory()
        self._drives_due_ns = 0
        self._safety_published: tuple[object, ...] | None = None

    def begin_core(self) -> None:
        """Clear what belongs to the previous core."""
        self._emergencies.core_started()

    def add(self, record: CycleRecord) -> None:
        """Add one record."""
        self._emergencies.add(record)

    def publish_drives(self, now_ns: int) -> None:
        """Publish all drives of the newest record, ten times a second."""
        if self._core.newest is None or now_ns < self._drives_due_ns:
            return
        self._drives_due_ns = next_due(self._drives_due_ns, DRIVES_PERIOD_NS, now_ns)
        for drive in self._core.newest.drives:
            parts = ("drives", *drive.name.split("/"))
            self._outlet.put(self._drive_state(drive, self._outlet.next_seq(*parts)), *parts)

    def publish_safety(self, *, is_due: bool) -> None:
        """Publish `safety` if it is due, or has changed."""
        record = self._core.record
        holder = self._leases.holder
        state = (record.mode, record.stage, record.verdict, holder) if record else ()
        if state == self._safety_published and not is_due:
            return
        self._safety_published = state
        self._outlet.put(self._safety(self._outlet.next_seq(wire.SAFETY)), wire.SAFETY)

    def status(
        self, head: dict[str, Any], events: Iterable[wire.Event], plan: wire.PlanLimits | None
    ) -> wire.Status:
        """The answer `status`; all its messages have the number of its head."""
        header, record, stamp = self._core.link.header, self._core.record, self._core.stamp
        views = [translate.view_of(leg, record, stamp) for leg in record.legs] if record else []
        drives, seq = record.drives if record else (), head["seq"]
        return wire.Status(
            **head,
            version=header.version if header else None,
            safety=self._safety(seq),
            drives=tuple(self._drive_state(drive, seq) for drive in drives),
            legs=tuple(translate.activity(view, seq) for view in views),
            events=tuple(events),
            plan=plan,
        )

    def _drive_state(self, drive: DriveRecord, seq: int) -> wire.DriveState:
        emergencies = self._emergencies.messages(drive.name)
        return translate.drive_state(drive, self._core.stamp, seq, emergencies)

    def _safety(self, seq: int) -> wire.Safety:
        link, record = self._core.link, self._core.record
        limits = link.header.limits if link.header else None
        message = translate.safety(record, limits, self._core.stamp, seq, self._leases.holder)
        if record is None and link.starting:
            starts = wire.Progress(code=ProgressCode.CORE_STARTING, subject=None, values={})
            return msgspec.structs.replace(message, progress=starts)
        return message


def next_due(due_ns: int, period_ns: int, now_ns: int) -> int:
    """The next due time, on the grid of `due_ns`; after a delay a period from now, so no bursts."""
    return due_ns + period_ns if due_ns + period_ns > now_ns else now_ns + period_ns
