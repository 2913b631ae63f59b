"""Lease and setpoints together, and the events about them.

Joins `lease.py` and `setpoints.py`, and reads from the records which setpoints the core accepted.
Each method returns the events to publish; none of them contains the number of the lease.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from gaitd_client import wire
from gaitd_names import EventCode, Lapse, Mode, Outcome, RefusalCode, SetpointRefusal

from daemon.gateway.events import EventDraft, Kind, Priority
from daemon.gateway.lease import Ended, LeaseEnd, LeaseManager, LeaseRefusedError
from daemon.gateway.setpoints import Batch, SetpointStore
from daemon.ipc.record import CycleRecord, Setpoint
from daemon.report_messages import refused

STOPPED: Final = frozenset({Mode.STOPPING, Mode.FAULT})
"""Modes in which no lease can be held."""
REPORTED_MAX: Final = 10
REPORT_WINDOW_NS: Final = 10_000_000_000
"""At most REPORTED_MAX refusals are published as events in this time; all are counted."""


class Decision(NamedTuple):
    """The answer to a query for the lease."""

    outcome: Outcome
    refusal: wire.Refusal | None = None
    number: int | None = None
    """Number of the lease; sent only to the client of the query."""
    duration_ms: int | None = None
    renewed: bool = False
    """The lease was only renewed, which makes no event."""


@dataclass(slots=True)
class LeaseControl:
    """The lease and its setpoints in the gateway."""

    leases: LeaseManager
    refused_count: dict[SetpointRefusal, int] = field(default_factory=dict[SetpointRefusal, int])
    """Setpoints refused by this gateway since its start, by reason."""
    _setpoints: SetpointStore = field(default_factory=SetpointStore)
    _legs: tuple[str, ...] = ()
    _before: CycleRecord | None = None
    _reported: set[SetpointRefusal] = field(default_factory=set[SetpointRefusal])
    """Reasons published under this lease, or since there is none."""
    _reported_ns: deque[int] = field(default_factory=lambda: deque(maxlen=REPORTED_MAX))

    @property
    def lease(self) -> int:
        """Number of the lease that is held; 0: none."""
        return self.leases.number

    @property
    def setpoints(self) -> tuple[Setpoint, ...]:
        """The newest setpoint of each leg under the lease that is held."""
        return self._setpoints.newest

    def begin_core(self, legs: tuple[str, ...]) -> list[EventDraft]:
        """End the lease, because the first core or a restarted one was found."""
        self._legs, self._before = legs, None
        return self._end(LeaseEnd.CORE_RESTARTED)

    def receive_record(self, record: CycleRecord, now_ns: int) -> list[EventDraft]:
        """Update from a record: renew the lease for accepted setpoints, report refusals."""
        before, self._before = self._before, record
        assist = record.assist
        drafts: list[EventDraft] = []
        if before is not None:
            if assist.accepted_count > before.assist.accepted_count:
                self.leases.renew(now_ns)
            if assist.lapse_count > before.assist.lapse_count:
                drafts.append(_lapsed(self.leases.holder, assist.lapse_reason))
            drafts += self._refused_by_core(before, record, now_ns)
        if record.mode in STOPPED:
            drafts += self._end(LeaseEnd.MACHINE_STOPPED)
        return drafts

    def receive_setpoints(self, batch: Batch, now_ns: int) -> list[EventDraft]:
        """Check the messages received on LEG/setpoint."""
        drafts: list[EventDraft] = []
        if batch.dropped_count:
            drafts += self._refuse(SetpointRefusal.FLOOD, batch.dropped_count, now_ns)
        for arrival in batch.arrivals:
            refusal = self._setpoints.receive(arrival, self._legs, self.lease)
            if refusal is not None:
                drafts += self._refuse(refusal, 1, now_ns)
        return drafts

    def decide(self, payload: wire.Ask, mode: Mode | None, now_ns: int) -> Decision:
        """Grant, renew or end the lease for a query to acquire or release.

        Args:
            payload: `wire.AcquireAsk` or `wire.ReleaseAsk`.
            mode: of the core; None: no records arrive from it.
            now_ns: the time.
        """
        try:
            return self._decide(payload, mode, now_ns)
        except LeaseRefusedError as error:
            return Decision(Outcome.REFUSED, error.refusal)

    def _decide(self, payload: wire.Ask, mode: Mode | None, now_ns: int) -> Decision:
        if isinstance(payload, wire.ReleaseAsk):
            self.leases.release(payload.client, payload.lease)
            self._clear()
            return Decision(Outcome.DONE)
        if not isinstance(payload, wire.AcquireAsk):
            raise TypeError(f"{type(payload).__name__} is no request for a lease")
        if payload.client in {"", wire.UNNAMED_CLIENT}:
            raise LeaseRefusedError(refused(RefusalCode.HOLDER_UNNAMED))
        if mode is None:
            raise LeaseRefusedError(refused(RefusalCode.CORE_SILENT))
        if mode in STOPPED:
            raise LeaseRefusedError(refused(RefusalCode.MACHINE_STOPPED))
        number, duration_ms, renewed = self.leases.acquire(
            payload.client, payload.lease, payload.duration_ms, now_ns
        )
        if not renewed:
            self._clear()
        return Decision(Outcome.DONE, None, number, duration_ms, renewed)

    def refuse_report(self, report: wire.ReportAsk) -> wire.Refusal | None:
        """Why a state is not published: its client does not hold the lease, or no such leg."""
        try:
            self.leases.check_holder(report.client, report.lease)
        except LeaseRefusedError as error:
            return error.refusal
        known = ", ".join(self._legs)
        return None if report.leg in self._legs else refused(RefusalCode.UNKNOWN_LEG, known)

    def stop(self) -> list[EventDraft]:
        """End the lease because a client has requested a stop."""
        return self._end(LeaseEnd.STOP_REQUESTED)

    def tick(self, now_ns: int) -> list[EventDraft]:
        """End the lease if its time is over."""
        ended = self.leases.tick(now_ns)
        return self._ended(ended)

    def _end(self, why: LeaseEnd) -> list[EventDraft]:
        return self._ended(self.leases.end(why))

    def _ended(self, ended: Ended | None) -> list[EventDraft]:
        if ended is None:
            return []
        self._clear()
        values = {"client": ended.client, "lease_end": ended.why}
        return [EventDraft(Priority.INFO, Kind.REQUEST, EventCode.LEASE_ENDED, values)]

    def _clear(self) -> None:
        self._setpoints.clear()
        self._reported.clear()

    def _refused_by_core(
        self, before: CycleRecord, record: CycleRecord, now_ns: int
    ) -> list[EventDraft]:
        was = before.assist.refused_count
        return [
            happening
            for reason, count in record.assist.refused_count.items()
            if count > was.get(reason, 0)
            for happening in self._report(reason, now_ns)
        ]

    def _refuse(self, reason: SetpointRefusal, count: int, now_ns: int) -> list[EventDraft]:
        self.refused_count[reason] = self.refused_count.get(reason, 0) + count
        return self._report(reason, now_ns)

    def _report(self, reason: SetpointRefusal, now_ns: int) -> list[EventDraft]:
        full = len(self._reported_ns) == REPORTED_MAX
        if reason in self._reported or (full and now_ns - self._reported_ns[0] < REPORT_WINDOW_NS):
            return []
        self._reported.add(reason)
        self._reported_ns.append(now_ns)
        values = {"holder": self.leases.holder, "setpoint_refusal": reason}
        return [EventDraft(Priority.LOW, Kind.REQUEST, EventCode.SETPOINT_REFUSED, values)]


def _lapsed(holder: str | None, lapse: Lapse) -> EventDraft:
    values = {"client": holder, "lapse": lapse}
    return EventDraft(Priority.MEDIUM, Kind.MODE, EventCode.ASSIST_LAPSED, values)
