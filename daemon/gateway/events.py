"""Events made from records: each change between two records is reported once, with a priority.

Priorities follow IEC 60601-1-8: high needs an immediate reaction, medium a prompt one, low
attention; info is no alarm. A verdict is the alarm; the mode change that follows from it is not
another one. Changes of a drive's inputs are reported only after its first statusword.

The core reports its own events (`CycleRecord.events`). They are passed on, except one that only
names the cause of a new verdict: the event of the verdict has priority and remedy.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, NamedTuple

from gaitd_client import wire
from gaitd_client.wire.fields import NMT_STATES
from gaitd_client.wire.names import Kind, Priority

from daemon.gateway.translate import Stamp, head, named_values, power_state_name
from daemon.ipc.record import (
    Cause,
    CycleRecord,
    DriveRecord,
    EmergencyRecord,
    Mode,
    StopCategory,
    Verdict,
)
from daemon.ipc.report import Event, EventCode
from daemon.wire.cause_texts import CAUSE_TEXT
from daemon.wire.names import name_of
from daemon.wire.report_fields import EVENT_FIELDS, VERDICTS
from daemon.wire.report_texts import detail_text, event_text

HISTORY_COUNT: Final = 200
"""Number of events kept for late joiners."""

REQUESTS_MAX: Final = 20
REQUESTS_WINDOW_NS: Final = 10_000_000_000
"""At most REQUESTS_MAX events about requests are published in this time."""

REQUESTED: Final = frozenset({Cause.STOP_REQUESTED, Cause.SHUTDOWN})
"""Causes of a stop that was requested."""
INTERMEDIATE: Final = frozenset(
    {"not_ready_to_switch_on", "ready_to_switch_on", "switched_on", "fault_reaction_active"}
)
"""Intermediate power states, which make no event."""
BY_PERSON: Final = frozenset({Cause.HAND_SWITCH_OPEN, Cause.STO_ACTIVE})
"""Causes of a stop by a person at the machine: hand switch or safe torque off."""


class EventDraft(NamedTuple):
    """An event before it has an identity and a place in the history."""

    priority: Priority
    kind: Kind
    text: str
    remedy: str = ""
    cause: Cause | None = None
    subject: str | None = None
    event: Event | None = None
    """The core's event; None: the gateway has made this one."""


def claimed(client: str) -> str:
    """The name of a client that has keys and did not use them, in events and logs."""
    return f"{client} (claimed)"


CORE_BACK: Final = EventDraft(Priority.LOW, Kind.CORE, "records from the core arrive again")
NO_DESCRIPTOR: Final = EventDraft(
    Priority.MEDIUM,
    Kind.NOTE,
    "the gateway has no file descriptor left: no new client is served, nor a stop of one; "
    "end unneeded clients, or raise LimitNOFILE of its unit",
)
DESCRIPTOR_BACK: Final = EventDraft(
    Priority.LOW, Kind.NOTE, "the gateway has file descriptors again: new clients are served"
)


def new_events(before: CycleRecord | None, now: CycleRecord) -> list[EventDraft]:
    """All events between two consecutive records of a core; `before` is None for the first."""
    if before is None:
        drafts = [
            EventDraft(Priority.INFO, Kind.CORE, f"core is running, mode {name_of(now.mode)}")
        ]
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
    text = f"no record from the core for {silence_ms} ms: nothing that was shown is valid"
    remedy = "the drives stop by themselves; see the core's log"
    return EventDraft(Priority.HIGH, Kind.CORE, text, remedy)


def unread(what: str) -> EventDraft:
    """The event that data written by the core cannot be read."""
    remedy = "if it goes on: end core and gateway, and start both from one installation"
    return EventDraft(Priority.LOW, Kind.NOTE, what, remedy)


def failed(count: int, what: str) -> EventDraft:
    """The event that a bug in the gateway has ended a query, one of so many."""
    text = f"queries have failed in the gateway, {count} so far: {what}"
    return EventDraft(Priority.LOW, Kind.NOTE, text, "report it, with the gateway's log")


def request_sent(name: str, client: str) -> EventDraft:
    """The event that a client's request is sent to the core."""
    return EventDraft(Priority.INFO, Kind.REQUEST, f"{name}, asked by {client}")


def request_answered(name: str, client: str, outcome: str, reason: str) -> EventDraft:
    """The event that the gateway has answered a client's request."""
    drafts = f"{name}, asked by {client}: {outcome}"
    return EventDraft(Priority.INFO, Kind.REQUEST, f"{drafts}: {reason}" if reason else drafts)


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
        text = f"{left_out} more events about requests in {REQUESTS_WINDOW_NS // 10**9} s"
        return [EventDraft(Priority.LOW, Kind.REQUEST, text, "see the request log for the client")]


class EventLog:
    """The bounded history of events, and the identity of each event.

    An id is BOOT-RECORD-INDEX: the core's boot id, the number of the newest record, and the index
    of the event since that record, from 1.
    """

    def __init__(self) -> None:
        self.history: deque[wire.Event] = deque(maxlen=HISTORY_COUNT)
        self._place = ("none", 0)
        self._index = 0

    def add(
        self,
        drafts: Iterable[EventDraft],
        stamp: Stamp,
        record_seq: int,
        time_ns: int,
        next_seq: Callable[[], int],
    ) -> list[wire.Event]:
        """Give the events their identities, add them to the history and return them."""
        place = (stamp.core_boot_id or "none", record_seq)
        if place != self._place:
            self._place, self._index = place, 0
        made = [self._event(item, stamp, time_ns, next_seq()) for item in drafts]
        self.history.extend(made)
        return made

    def _event(self, item: EventDraft, stamp: Stamp, time_ns: int, seq: int) -> wire.Event:
        self._index += 1
        boot_id, record_seq = self._place
        return wire.Event(
            **head(stamp, seq),
            id=f"{boot_id}-{record_seq}-{self._index}",
            time_ns=time_ns,
            priority=item.priority.value,
            kind=item.kind.value,
            text=item.text,
            remedy=item.remedy,
            cause=name_of(item.cause) if item.cause is not None else None,
            subject=item.subject,
            **_coded(item.event),
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
    return EventDraft(priority, kind, event_text(event), subject=subject, event=event)


def _coded(event: Event | None) -> dict[str, Any]:
    """The fields of a message that tell a program what has happened."""
    if event is None:
        return {}
    names = EVENT_FIELDS[event.code]
    values = named_values(names, event.values[: len(names)])
    return {"code": name_of(event.code), "values": values, "said": event.said}


def _names_cause(event: Event, cause: Cause) -> bool:
    return event.code in VERDICTS and event.values[1:2] == (cause,)


def _has_no_mode(drafts: Iterable[EventDraft]) -> bool:
    return all(item.kind is not Kind.MODE for item in drafts)


def _mode_change(before: Mode, now: Mode) -> list[EventDraft]:
    if before is now:
        return []
    text = f"mode {name_of(before)} → {name_of(now)}"
    priority = Priority.MEDIUM if now is Mode.FAULT else Priority.INFO
    return [EventDraft(priority, Kind.MODE, text)]


def _verdict_change(before: Verdict, now: Verdict) -> list[EventDraft]:
    if (before.category, before.cause, before.drive) == (now.category, now.cause, now.drive):
        return []
    if now.category is StopCategory.NONE and now.cause is Cause.NONE:
        return [EventDraft(Priority.INFO, Kind.STOP, "the verdict is cleared")]
    return [_stop(now)]


def _stop(verdict: Verdict) -> EventDraft:
    text = CAUSE_TEXT[verdict.cause]
    words = [f"stop {verdict.category.name}: {text.title}"]
    if verdict.drive:
        words.append(f"({verdict.drive})")
    if verdict.limit:
        words.append(f"{verdict.value:.4g}, limit {verdict.limit:.4g}")
    if detail := detail_text(verdict):
        words.append(f"- {detail}")
    priority = _priority(verdict.cause)
    subject = verdict.drive or None
    return EventDraft(priority, Kind.STOP, " ".join(words), text.remedy, verdict.cause, subject)


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
        nmt_state = NMT_STATES.get(now.nmt_state, "unknown")
        yield _drive_event(now, Priority.INFO, Kind.DRIVE, f"NMT state {nmt_state}")
    state = power_state_name(now.power_state)
    if before.power_state != now.power_state and state not in INTERMEDIATE:
        priority = Priority.MEDIUM if state == "fault" else Priority.INFO
        yield _drive_event(now, priority, Kind.DRIVE, state.replace("_", " "))
    if _is_seen(before) and before.referenced != now.referenced:
        text = "knows its position" if now.referenced else "does not know its position any more"
        priority = Priority.INFO if now.referenced else Priority.MEDIUM
        yield _drive_event(now, priority, Kind.DRIVE, text)


def _emergency_changes(before: DriveRecord, now: DriveRecord) -> Iterator[EventDraft]:
    for emergency in now.emergencies:
        if not emergency.repeated:
            yield _emergency(now, emergency)
    told_without_details = now.emergency_code and not now.emergencies
    if now.emergency_count > before.emergency_count and told_without_details:
        text = f"EMCY 0x{now.emergency_code:04X}: {now.emergency_text}"
        yield _drive_event(now, Priority.HIGH, Kind.EMERGENCY, text)
    elif before.emergency_code and not now.emergency_code:
        yield _drive_event(now, Priority.INFO, Kind.EMERGENCY, "EMCY cleared")


def _emergency(drive: DriveRecord, emergency: EmergencyRecord) -> EventDraft:
    words = [f"EMCY 0x{emergency.code:04X}: {emergency.text}; the drive: {emergency.reaction}"]
    if emergency.loses_reference:
        words.append("it does not know its position any more")
    words.append(f"register 0x{emergency.error_register:02X}, vendor {emergency.vendor_bytes}")
    priority = Priority.HIGH if emergency.alarm else Priority.LOW
    return _drive_event(drive, priority, Kind.EMERGENCY, "; ".join(words))


def _input_changes(before: DriveRecord, now: DriveRecord) -> Iterator[EventDraft]:
    if before.hand_switch_closed != now.hand_switch_closed:
        state = "closed" if now.hand_switch_closed else "open"
        priority = Priority.INFO if now.hand_switch_closed else Priority.MEDIUM
        yield _drive_event(now, priority, Kind.INPUT, f"hand switch {state}")
    if before.sto_released != now.sto_released:
        state = "released" if now.sto_released else "active"
        priority = Priority.INFO if now.sto_released else Priority.MEDIUM
        yield _drive_event(now, priority, Kind.INPUT, f"safe torque off {state}")


def _drive_event(drive: DriveRecord, priority: Priority, kind: Kind, text: str) -> EventDraft:
    return EventDraft(priority, kind, f"{drive.name}: {text}", subject=drive.name)
