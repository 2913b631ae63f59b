"""Events made from records: each change between two records is reported once, with a priority.

Priorities follow IEC 60601-1-8: high needs an immediate reaction, medium a prompt one, low
attention; info is no alarm. A verdict is the alarm; the mode change that follows from it is not
another one. Changes of a drive's inputs are reported only after its first statusword.

The core reports its own events (`CycleRecord.events`). They are passed on, except one that only
names the cause of a new verdict: the event of the verdict has priority and remedy.
"""

import logging
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

from gaitd_client import wire
from gaitd_names import (
    NMT_STATES,
    Cause,
    EventCode,
    Kind,
    Mode,
    Priority,
    RefusalCode,
    StopCategory,
)
from gaitd_texts import Reader, catalogue

from daemon.gateway.core_view import CoreView
from daemon.gateway.outlet import Outlet
from daemon.gateway.translate import head, power_state_name
from daemon.ipc.record import CycleRecord, DriveRecord, EmergencyRecord, Verdict
from daemon.ipc.report import Event
from daemon.report_messages import event_values, refused, verdict_values
from daemon.system.clock import AgeClock
from daemon.wire.report_fields import VERDICTS

HISTORY_COUNT: Final = 200
"""Number of events kept for late joiners."""

REQUESTS_MAX: Final = 20
REQUESTS_WINDOW_NS: Final = 10_000_000_000
"""At most REQUESTS_MAX events about requests are published in this time."""

MARKS_MAX: Final = 10
MARKS_WINDOW_NS: Final = 10_000_000_000
"""At most MARKS_MAX marks are published in this time: they share the history with stops."""

REQUESTED: Final = frozenset({Cause.STOP_REQUESTED, Cause.SHUTDOWN})
"""Causes of a stop that was requested."""
INTERMEDIATE: Final = frozenset(
    {"not_ready_to_switch_on", "ready_to_switch_on", "switched_on", "fault_reaction_active"}
)
"""Intermediate power states, which make no event."""
BY_PERSON: Final = frozenset({Cause.HAND_SWITCH_OPEN, Cause.STO_ACTIVE})
"""Causes of a stop by a person at the machine: hand switch or safe torque off."""
_JOURNAL_LEVEL: Final = {
    Priority.HIGH.value: logging.ERROR,
    Priority.MEDIUM.value: logging.WARNING,
    Priority.LOW.value: logging.INFO,
    Priority.INFO.value: logging.INFO,
}


class EventDraft(NamedTuple):
    """An event before it has an identity and a place in the history."""

    priority: Priority
    kind: Kind
    code: str
    values: Mapping[str, float | str | None] = MappingProxyType({})
    subject: str | None = None
    said: str = ""
    cause: Cause | None = None
    """That of a stop; else none."""


def claimed(client: str) -> str:
    """The name of a client that has keys and did not use them, in events and logs."""
    return f"{client} (claimed)"


CORE_BACK: Final = EventDraft(Priority.LOW, Kind.CORE, EventCode.CORE_BACK)
NO_DESCRIPTOR: Final = EventDraft(Priority.MEDIUM, Kind.NOTE, EventCode.DESCRIPTORS_USED_UP)
DESCRIPTOR_BACK: Final = EventDraft(Priority.LOW, Kind.NOTE, EventCode.DESCRIPTORS_FREE)


def new_events(before: CycleRecord | None, now: CycleRecord) -> list[EventDraft]:
    """All events between two consecutive records of a core; `before` is None for the first."""
    if before is None:
        mode = {"mode": now.mode}
        drafts = [EventDraft(Priority.INFO, Kind.CORE, EventCode.CORE_RUNNING, mode)]
        latched = _verdict_change(Verdict(), now.verdict)
        return drafts + latched + [_of_core(event) for event in now.events]
    stops = _verdict_change(before.verdict, now.verdict)
    cause = now.verdict.cause
    told = [_of_core(event) for event in now.events if not (stops and _names_cause(event, cause))]
    modes = _mode_change(before.mode, now.mode) if _has_no_mode(told) else []
    past = {drive.name: drive for drive in before.drives}
    seen = [drive for drive in now.drives if drive.name in past]
    drives = [drafts for drive in seen for drafts in _drive_changes(past[drive.name], drive)]
    return [*drives, *stops, *modes, *told]


def core_lost(silence_ms: int) -> EventDraft:
    """The event that no records arrive from the core any more."""
    return EventDraft(Priority.HIGH, Kind.CORE, EventCode.CORE_SILENT, {"silence_ms": silence_ms})


def unread(count: int) -> EventDraft:
    """The event that so many records of the core cannot be read."""
    values = {"unread_count": count}
    return EventDraft(Priority.LOW, Kind.NOTE, EventCode.RECORDS_UNREAD, values)


def failed(count: int, what: str) -> EventDraft:
    """The event that a bug in the gateway has ended a query, one of so many."""
    values = {"failed_count": count}
    return EventDraft(Priority.LOW, Kind.NOTE, EventCode.QUERY_FAILED, values, said=what)


def mark(client: str, text: str) -> EventDraft:
    """The event that a person has written a mark."""
    return EventDraft(Priority.INFO, Kind.NOTE, EventCode.MARK, {"client": client}, said=text)


def request_sent(name: str, client: str) -> EventDraft:
    """The event that a client's request is sent to the core."""
    values = {"request": name, "client": client}
    return EventDraft(Priority.INFO, Kind.REQUEST, EventCode.REQUEST_SENT, values)


def request_answered(
    name: str, client: str, outcome: str, refusal: wire.Refusal | None
) -> EventDraft:
    """The event that the gateway has answered a client's request."""
    values: wire.Values = {"request": name, "client": client, "outcome": outcome}
    if refusal is None:
        return EventDraft(Priority.INFO, Kind.REQUEST, EventCode.REQUEST_ANSWERED, values)
    return EventDraft(
        Priority.INFO,
        Kind.REQUEST,
        EventCode.REQUEST_ANSWERED,
        {**values, **refusal.values, "refusal": refusal.code},
        refusal.subject,
        refusal.said,
    )


class DescriptorEvents:
    """Reports once that descriptors are used up, and once that one is free: Zenoh reports none."""

    def __init__(self) -> None:
        self._had_one = True

    def turn(self, *, has_one: bool) -> list[EventDraft]:
        """Return the event of a change since the last turn; `has_one`: a descriptor is free."""
        had_one, self._had_one = self._had_one, has_one
        if had_one == has_one:
            return []
        return [DESCRIPTOR_BACK if has_one else NO_DESCRIPTOR]


class RequestEvents:
    """Limits the events about requests: a flood of them must not displace the causes of stops."""

    def __init__(self) -> None:
        self._begin_ns = self._count = 0

    def due(self, draft: EventDraft) -> list[EventDraft]:
        """The event, if it is one of the first of this time; the request log has the others."""
        self._count += 1
        return [draft] if self._count <= REQUESTS_MAX else []

    def tick(self, now_ns: int) -> list[EventDraft]:
        """Begin the next time; the event about the requests of the last one that made none."""
        if now_ns - self._begin_ns < REQUESTS_WINDOW_NS:
            return []
        left_out = self._count - REQUESTS_MAX
        self._begin_ns, self._count = now_ns, 0
        if left_out <= 0:
            return []
        values = {"left_out_count": left_out, "window_s": REQUESTS_WINDOW_NS // 10**9}
        return [EventDraft(Priority.LOW, Kind.REQUEST, EventCode.REQUESTS_LEFT_OUT, values)]


class MarkBudget:
    """Limits the marks of all clients together."""

    def __init__(self) -> None:
        self._written_ns: deque[int] = deque(maxlen=MARKS_MAX)

    def take(self, now_ns: int) -> wire.Refusal | None:
        """Count a mark; return why there may be none now."""
        is_full = len(self._written_ns) == MARKS_MAX
        if is_full and now_ns - self._written_ns[0] < MARKS_WINDOW_NS:
            window_s = MARKS_WINDOW_NS // 10**9
            return refused(RefusalCode.TOO_MANY_MARKS, highest=MARKS_MAX, window_s=window_s)
        self._written_ns.append(now_ns)
        return None


class EventLog:
    """Publishes events and keeps a bounded history of them.

    An id is BOOT-RECORD-INDEX: the core's boot id, the number of the newest record, and the index
    of the event since that record, from 1.
    """

    def __init__(self, outlet: Outlet, core: CoreView, clock: AgeClock) -> None:
        self._outlet, self._core, self._clock = outlet, core, clock
        self._texts = catalogue(Reader.OPERATOR, "en")
        self._journal = logging.getLogger("gaitd.gateway")
        self._requests = RequestEvents()
        self._place = ("none", 0)
        self._index = 0
        self.history: deque[wire.Event] = deque(maxlen=HISTORY_COUNT)

    def publish(self, drafts: Iterable[EventDraft], time_ns: int | None = None) -> None:
        """Publish events.

        Args:
            drafts: without identity.
            time_ns: UTC of the record that they come from; None: now.
        """
        for draft in drafts:
            event = self._event(draft, self._clock.utc_ns() if time_ns is None else time_ns)
            self.history.append(event)
            self._outlet.put_event(event)
            newest = self._core.newest
            extra = {"event": event, "mode": newest and newest.mode}
            level = _JOURNAL_LEVEL[event.priority]
            self._journal.log(level, "%s", self._texts.event(event), extra=extra)

    def publish_request(self, draft: EventDraft) -> None:
        """Publish an event about a request, if there are not too many."""
        self.publish(self._requests.due(draft))

    def tick(self, now_ns: int) -> None:
        """Publish that events about requests were left out."""
        self.publish(self._requests.tick(now_ns))

    def _event(self, item: EventDraft, time_ns: int) -> wire.Event:
        newest, stamp = self._core.newest, self._core.stamp
        place = (stamp.core_boot_id or "none", newest.seq if newest else 0)
        self._index = self._index + 1 if place == self._place else 1
        self._place = place
        return wire.Event(
            **head(stamp, self._outlet.next_seq(wire.EVENTS)),
            id=f"{place[0]}-{place[1]}-{self._index}",
            time_ns=time_ns,
            priority=item.priority.value,
            kind=item.kind.value,
            code=item.code,
            cause=item.cause,
            subject=item.subject,
            values=dict(item.values),
            said=item.said,
        )


_LOW: Final = frozenset(code for code in EventCode if code.name.startswith("CAN_"))
"""Events of the core that need attention: those of the CAN controller."""
_KINDS: Final = {
    EventCode.MODE_CHANGED: Kind.MODE,
    EventCode.REQUEST_RECEIVED: Kind.REQUEST,
    EventCode.REQUEST_REFUSED: Kind.REQUEST,
    EventCode.REQUEST_DONE: Kind.REQUEST,
}
"""Kinds of the core's events; the others are notes."""


def _of_core(event: Event) -> EventDraft:
    priority = Priority.LOW if event.code in _LOW else Priority.INFO
    kind, subject = _KINDS.get(event.code, Kind.NOTE), event.subject or None
    return EventDraft(priority, kind, event.code, event_values(event), subject, event.said)


def _names_cause(event: Event, cause: Cause) -> bool:
    return event.code in VERDICTS and event.values[1:2] == (cause,)


def _has_no_mode(drafts: Iterable[EventDraft]) -> bool:
    return all(item.kind is not Kind.MODE for item in drafts)


def _mode_change(before: Mode, now: Mode) -> list[EventDraft]:
    if before is now:
        return []
    values = {"mode_before": before, "mode": now, "trigger": None}
    priority = Priority.MEDIUM if now is Mode.FAULT else Priority.INFO
    return [EventDraft(priority, Kind.MODE, EventCode.MODE_CHANGED, values)]


def _verdict_change(before: Verdict, now: Verdict) -> list[EventDraft]:
    if (before.category, before.cause, before.drive) == (now.category, now.cause, now.drive):
        return []
    if now.category is StopCategory.NONE and now.cause is Cause.NONE:
        return [EventDraft(Priority.INFO, Kind.STOP, EventCode.VERDICT_CLEARED)]
    return [_stop(now)]


def _stop(verdict: Verdict) -> EventDraft:
    return EventDraft(
        _priority(verdict.cause),
        Kind.STOP,
        EventCode.STOPPED,
        verdict_values(verdict),
        verdict.drive or None,
        verdict.said,
        verdict.cause,
    )


def _priority(cause: Cause) -> Priority:
    if cause in REQUESTED:
        return Priority.LOW
    return Priority.MEDIUM if cause in BY_PERSON else Priority.HIGH


def _drive_changes(before: DriveRecord, now: DriveRecord) -> list[EventDraft]:
    """Nothing of a drive that is not seen: the events of the mode and the bring-up say why."""
    if not _is_seen(now):
        return []
    drafts = [*_state_changes(before, now), *_emergency_changes(before, now)]
    if _has_statusword(before) and _has_statusword(now):
        drafts += _input_changes(before, now)
    return drafts


def _has_statusword(drive: DriveRecord) -> bool:
    """True if a statusword, and with it the inputs, has been received from this drive."""
    return power_state_name(drive.power_state) != "unknown"


def _is_seen(drive: DriveRecord) -> bool:
    """False without drives: the record of a drive has no value then, not even its references."""
    nmt_state = NMT_STATES.get(drive.nmt_state, "unknown")
    return nmt_state != "unknown" or _has_statusword(drive)


def _state_changes(before: DriveRecord, now: DriveRecord) -> Iterator[EventDraft]:
    if _is_seen(before) and before.nmt_state != now.nmt_state:
        values = {"nmt_state": NMT_STATES.get(now.nmt_state, "unknown")}
        yield EventDraft(Priority.INFO, Kind.DRIVE, EventCode.NMT_STATE_CHANGED, values, now.name)
    state = power_state_name(now.power_state)
    if before.power_state != now.power_state and state not in INTERMEDIATE:
        priority = Priority.MEDIUM if state == "fault" else Priority.INFO
        values = {"power_state": state}
        yield EventDraft(priority, Kind.DRIVE, EventCode.POWER_STATE_CHANGED, values, now.name)
    if _is_seen(before) and before.referenced != now.referenced:
        code = EventCode.POSITION_KNOWN if now.referenced else EventCode.POSITION_LOST
        priority = Priority.INFO if now.referenced else Priority.MEDIUM
        yield EventDraft(priority, Kind.DRIVE, code, subject=now.name)


def _emergency_changes(before: DriveRecord, now: DriveRecord) -> Iterator[EventDraft]:
    for emergency in now.emergencies:
        if not emergency.repeated:
            yield _emergency(now, emergency)
    told_without_details = now.emergency_code and not now.emergencies
    if now.emergency_count > before.emergency_count and told_without_details:
        yield EventDraft(
            Priority.HIGH,
            Kind.EMERGENCY,
            EventCode.EMCY_RECEIVED,
            {"emcy_code": now.emergency_code},
            now.name,
            now.emergency_text,
        )
    elif before.emergency_code and not now.emergency_code:
        yield EventDraft(Priority.INFO, Kind.EMERGENCY, EventCode.EMCY_CLEARED, subject=now.name)


def _emergency(drive: DriveRecord, emergency: EmergencyRecord) -> EventDraft:
    return EventDraft(
        Priority.HIGH if emergency.alarm else Priority.LOW,
        Kind.EMERGENCY,
        EventCode.EMCY_RECEIVED,
        {"emcy_code": emergency.code},
        drive.name,
        f"{emergency.text}; drive: {emergency.reaction}; "
        f"{emergency.error_register:02X}h {emergency.vendor_bytes}",
    )


def _input_changes(before: DriveRecord, now: DriveRecord) -> Iterator[EventDraft]:
    if before.hand_switch_closed != now.hand_switch_closed:
        closed = now.hand_switch_closed
        code = EventCode.HAND_SWITCH_CLOSED if closed else EventCode.HAND_SWITCH_OPENED
        priority = Priority.INFO if closed else Priority.MEDIUM
        yield EventDraft(priority, Kind.INPUT, code, subject=now.name)
    if before.sto_released != now.sto_released:
        code = EventCode.STO_RELEASED if now.sto_released else EventCode.STO_ACTIVATED
        priority = Priority.INFO if now.sto_released else Priority.MEDIUM
        yield EventDraft(priority, Kind.INPUT, code, subject=now.name)
