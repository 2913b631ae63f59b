"""One turn of the gateway's loop: records in, messages out; queries in, gateway state out.

The order within a turn: first read the new records and publish the estimates of the young ones
(`hurry`). Then (`turn`) publish the records' other messages and their events; check for the core's
silence; take setpoints; take queries; answer what has an answer; send the gateway state; publish
the messages that are due once a second. Nothing here blocks, and the time is an argument.
"""

import logging
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple, Protocol

import msgspec

from daemon import wire
from daemon.config.settings import Lease
from daemon.gateway import events, requests, translate
from daemon.gateway.emergencies import EmergencyHistory
from daemon.gateway.health import HealthWindow
from daemon.gateway.lease import LeaseManager
from daemon.gateway.leg_messages import LegMessages
from daemon.gateway.outlet import Outlet
from daemon.gateway.presence import SILENCE_NS, Presence
from daemon.gateway.setpoints import NOTHING, Batch
from daemon.gateway.steering import Steering
from daemon.gateway.translate import Stamp
from daemon.ipc.record import CycleRecord, DriveRecord, Outcome
from daemon.ipc.transport import GatewaySeam, RareNotice, RingError, RingHeader
from daemon.system.clock import AgeClock
from daemon.wire.fields import name_of, printable

LEVEL_PERIOD_NS: Final = 20_000_000
DRIVES_PERIOD_NS: Final = 100_000_000
SECOND_NS: Final = 1_000_000_000
STATUS_EVENT_COUNT: Final = 20

_LOG_LEVEL: Final = {
    events.Priority.HIGH.value: logging.ERROR,
    events.Priority.MEDIUM.value: logging.WARNING,
    events.Priority.LOW.value: logging.INFO,
    events.Priority.INFO.value: logging.INFO,
}


class Inquiry(Protocol):
    """A query to control/NAME that waits for its only answer."""

    name: str
    payload: bytes

    def answer(self, message: msgspec.Struct, *, failed: bool = False) -> None:
        """Send the reply and finish the query."""
        ...


class Waiting(NamedTuple):
    """A query whose answer is outstanding, and the name of its client."""

    inquiry: Inquiry
    client: str


class Gateway:
    """The gateway between the IPC channel and the outlet."""

    def __init__(
        self,
        seam: GatewaySeam,
        outlet: Outlet,
        clock: AgeClock,
        trainer: str,
        listen: Sequence[str],
        lease: Lease,
    ) -> None:
        self._seam, self._outlet, self._clock = seam, outlet, clock
        self._trainer, self._listen = trainer, tuple(listen)
        self._log = logging.getLogger("gaitd.gateway")
        self._desk = requests.RequestQueue(first_level_seq=clock.now_ns())
        self.steering = Steering(LeaseManager(lease))
        self._presence = Presence()
        self._events = events.EventLog()
        self.health = HealthWindow()
        self._legs = LegMessages(outlet, clock, self.health)
        self.health.counters.setpoint_refused_count = self.steering.refused_count
        self._emergencies = EmergencyHistory()
        self._waiting: dict[int, Waiting] = {}
        self._ticket = 0
        self._boot_id = ""
        self._newest: CycleRecord | None = None
        self._fresh: list[CycleRecord] = []
        self._ring_trouble = ""
        self._failed, self._failed_count = RareNotice("queries have failed in the gateway"), 0
        self._safety_said: tuple[object, ...] | None = None
        self._level_due_ns = self._drives_due_ns = 0
        self._second_due_ns = clock.now_ns() + SECOND_NS

    def hurry(self, now_ns: int) -> bool:
        """Publish the estimates of new records; the rest of a turn can wait for a millisecond.

        Returns: whether there were new records.
        """
        records, header = self._records(), self._seam.header
        if not records or header is None:
            return False
        self._fresh += records
        self._legs.hurry(records, header.core_boot_id, now_ns)
        return True

    def turn(self, now_ns: int, inquiries: Sequence[Inquiry], batch: Batch = NOTHING) -> None:
        """One turn of the loop, after `hurry`."""
        records, self._fresh = self._fresh, []
        self._hear(records, now_ns)
        self.tell([events.unread(text) for text in self._seam.take_notices()])
        self._steer(self.steering.take(batch, now_ns))
        # A stop is handled before all other queries.
        for inquiry in sorted(inquiries, key=lambda one: one.name != "stop"):
            self._alone(inquiry, lambda one=inquiry: self._take(one, now_ns))
        self._settle(self._desk.tick(now_ns))
        self._steer(self.steering.tick(now_ns))
        self._say_safety(now_ns)
        if records or inquiries or batch.arrivals or now_ns >= self._level_due_ns:
            self._level_due_ns = now_ns + LEVEL_PERIOD_NS
            self._send_level()
        if now_ns >= self._second_due_ns:
            self._second_due_ns = _next_due(self._second_due_ns, SECOND_NS, now_ns)
            seq = self._outlet.next_seq(wire.HEALTH)
            self._outlet.put(self.health.close(self._stamp(), seq), wire.HEALTH)

    def _send_level(self) -> None:
        level = self._desk.level(self.steering.setpoints, self.steering.lease)
        if level and not self._seam.send(level) and self._presence.heard:
            self.health.counters.gateway_state_dropped_count += 1

    def tell(self, said: Sequence[events.Happening]) -> None:
        """Publish events that do not come from the core."""
        if said:
            self._say(said, self._clock.utc_ns())

    @property
    def status(self) -> str:
        """One line for systemd's status."""
        record = self._newest if self._presence.heard else None
        return f"core {name_of(record.mode)}" if record else "no records from a core"

    def close(self) -> None:
        """Answer the queries that still wait."""
        for ticket in tuple(self._waiting):
            answer = requests.Answer(ticket, Outcome.PENDING, "the gateway ends")
            self._settle([answer])

    # --- records ------------------------------------------------------------------------------

    def _records(self) -> list[CycleRecord]:
        try:
            records = self._seam.records()
        except RingError as error:
            # Logged once: the file stays as it is until another core writes it.
            if str(error) != self._ring_trouble:
                self._ring_trouble = str(error)
                self._log.error("%s", error)
            return []
        self._ring_trouble = ""
        return records

    def _hear(self, records: Sequence[CycleRecord], now_ns: int) -> None:
        header = self._seam.header
        if records and header:
            first_sight = self._newest is None or header.core_boot_id != self._boot_id
            back = not first_sight and not self._presence.heard
            self._presence.hear(now_ns)
            if first_sight:
                self._meet(header)
            self._legs.follow()
            for record in records:
                self._hear_one(record)
            if back:
                self._say([events.CORE_BACK], self._clock.utc_ns())
            # The newest record holds the outcomes of all stops and of the one request.
            self._settle(self._desk.hear(self._boot_id, records[-1]))
            self._steer(self.steering.hear(records[-1], now_ns))
            self._say_drives(now_ns)
        elif self._presence.falls_silent(now_ns):
            self._say([events.core_lost(SILENCE_NS // 1_000_000)], self._clock.utc_ns())
            self._settle(self._desk.lose_core())
        self._outlet.show_alive(self._presence.heard)

    def _meet(self, header: RingHeader) -> None:
        """Reset what belongs to the previous core: a record of a new core has arrived."""
        self._boot_id = header.core_boot_id
        self._newest = None
        self._steer(self.steering.meet(header.leg_names))
        self.health.core_started()
        self._emergencies.core_started()

    def _hear_one(self, record: CycleRecord) -> None:
        before, self._newest = self._newest, record
        if before is not None:
            self.health.counters.record_missed_count += max(record.seq - before.seq - 1, 0)
        self.health.note(record)
        self._emergencies.note(record)
        self._say(events.happenings(before, record), record.sync_utc_ns)

    # --- messages -----------------------------------------------------------------------------

    def _stamp(self) -> Stamp:
        return translate.stamp_of(self._boot_id, self._newest) if self._newest else Stamp()

    def _head(self, *parts: str) -> dict[str, Any]:
        return translate.head(self._stamp(), self._outlet.next_seq(*parts))

    def _say_drives(self, now_ns: int) -> None:
        if self._newest is None or now_ns < self._drives_due_ns:
            return
        self._drives_due_ns = _next_due(self._drives_due_ns, DRIVES_PERIOD_NS, now_ns)
        for drive in self._newest.drives:
            parts = ("drives", *drive.name.split("/"))
            message = self._drive_state(drive, self._outlet.next_seq(*parts))
            self._outlet.put(message, *parts)

    def _drive_state(self, drive: DriveRecord, seq: int) -> wire.DriveState:
        emergencies = self._emergencies.of(drive.name)
        return translate.drive_state(drive, self._stamp(), seq, emergencies)

    def _say_safety(self, now_ns: int) -> None:
        record = self._newest if self._presence.heard else None
        holder = self.steering.leases.holder
        said = (record.mode, record.stage, record.verdict, holder) if record else ()
        # Published in the same turn as `health`, which sets the next due time after this.
        if said == self._safety_said and now_ns < self._second_due_ns:
            return
        self._safety_said = said
        self._outlet.put(self._safety(self._outlet.next_seq(wire.SAFETY)), wire.SAFETY)

    def _safety(self, seq: int) -> wire.Safety:
        header = self._seam.header
        record = self._newest if self._presence.heard else None
        limits, holder = header.limits if header else None, self.steering.leases.holder
        return translate.safety(record, limits, self._stamp(), seq, holder)

    def _steer(self, said: Sequence[events.Happening]) -> None:
        if said:
            self._say(said, self._clock.utc_ns())

    def _say(self, said: Sequence[events.Happening], time_ns: int) -> None:
        record_seq = self._newest.seq if self._newest else 0
        made = self._events.add(
            said, self._stamp(), record_seq, time_ns, lambda: self._outlet.next_seq(wire.EVENTS)
        )
        for event in made:
            self._outlet.put_event(event)
            extra = {"event": event, "mode": self._newest and name_of(self._newest.mode)}
            self._log.log(_LOG_LEVEL[event.priority], "%s", event.text, extra=extra)

    # --- requests -----------------------------------------------------------------------------

    def _alone(self, inquiry: Inquiry, act: Callable[[], None], *, answers: bool = True) -> None:
        """Run an action for one query; an exception in it is our bug and ends only that query."""
        try:
            act()
        except Exception as bug:  # noqa: BLE001 - reported; other queries are still served
            what = f"{type(bug).__name__}: {bug}"
            self._log.exception("control/%r has failed", inquiry.name)
            self._failed_count += 1
            self.tell([events.failed(text) for text in self._failed.due(self._failed_count, what)])
            for ticket, waiting in tuple(self._waiting.items()):
                if waiting.inquiry is inquiry:
                    del self._waiting[ticket]
                    self._desk.withdraw(ticket)
            if answers:
                reason = f"internal error of the gateway: {what}"
                self._alone(inquiry, lambda: self._reject(inquiry, reason), answers=False)

    def _take(self, inquiry: Inquiry, now_ns: int) -> None:
        route = requests.ROUTES.get(inquiry.name)
        if route is None:
            known = ", ".join(requests.ROUTES)
            self._reject(
                inquiry, f"control/{printable(inquiry.name)} is unknown; known are {known}"
            )
            return
        self._ticket += 1
        if route is requests.Route.STOP:
            # Counted first, before anything that could fail.
            self._desk.stop(self._ticket, now_ns)
        try:
            ask = requests.read_ask(inquiry.name, inquiry.payload)
        except requests.BadPayloadError as error:
            # A stop takes effect whatever its payload is.
            if route is not requests.Route.STOP:
                self._reject(inquiry, str(error))
                return
            ask = wire.Ask()
        self._waiting[self._ticket] = Waiting(inquiry, ask.client)
        self._route(route, inquiry.name, ask, now_ns)

    def _route(self, route: requests.Route, name: str, ask: wire.Ask, now_ns: int) -> None:
        ticket = self._ticket
        match route:
            case requests.Route.STOP:
                self._steer(self.steering.stop())
            case requests.Route.CORE:
                answer = self._desk.ask(ticket, name, ask, now_ns)
                if answer is None:
                    self._say([events.asked(name, ask.client)], self._clock.utc_ns())
                else:
                    self._settle([answer])
            case requests.Route.LEASE:
                self._lease(ask, now_ns)
            case requests.Route.GATEWAY:
                self._waiting.pop(ticket).inquiry.answer(self._information(name))

    def _lease(self, ask: wire.Ask, now_ns: int) -> None:
        """Grant, renew or end the lease; its number is sent only to the client of the query."""
        inquiry, client = self._waiting.pop(self._ticket)
        mode = self._newest.mode if self._newest and self._presence.heard else None
        told = self.steering.decide(ask, mode, now_ns)
        reply = self._reply(inquiry.name, told.outcome, told.reason)
        lent = {"lease": told.number, "lease_duration_ms": told.duration_ms}
        inquiry.answer(msgspec.structs.replace(reply, **lent))
        if not told.renewed:
            said = events.answered(inquiry.name, client, name_of(told.outcome), told.reason)
            self._steer([said])

    def _settle(self, answers: Sequence[requests.Answer]) -> None:
        """Send answers, and publish the outcomes of requests as events."""
        for answer in answers:
            waiting = self._waiting.pop(answer.ticket, None)
            # A query that has failed does not wait any more.
            if waiting is not None:
                self._alone(
                    waiting.inquiry,
                    lambda answer=answer, waiting=waiting: self._answer(answer, waiting),
                )

    def _answer(self, answer: requests.Answer, waiting: Waiting) -> None:
        inquiry, outcome = waiting.inquiry, name_of(answer.outcome)
        inquiry.answer(self._reply(inquiry.name, answer.outcome, answer.reason))
        if not answer.by_core:
            told = events.answered(inquiry.name, waiting.client, outcome, answer.reason)
            self._say([told], self._clock.utc_ns())

    def _reject(self, inquiry: Inquiry, reason: str) -> None:
        inquiry.answer(self._reply(inquiry.name, Outcome.REFUSED, reason), failed=True)
        self._log.warning("query refused: %s", reason)

    def _reply(self, name: str, outcome: Outcome, reason: str) -> wire.Reply:
        record = self._newest if self._presence.heard else None
        return wire.Reply(
            # Unknown names share one counter, so that clients cannot create counters at will.
            **self._head(wire.CONTROL, name if name in requests.ROUTES else ""),
            request=name,
            outcome=name_of(outcome),
            reason=reason,
            mode=name_of(record.mode) if record else None,
        )

    def _information(self, name: str) -> msgspec.Struct:
        match name:
            case "status":
                return self._status()
            case "config":
                return self._configuration()
            case _:
                return wire.Schemas(**self._head(wire.CONTROL, name), schemas=wire.schemas())

    def _status(self) -> wire.Status:
        header, stamp = self._seam.header, self._stamp()
        head = self._head(wire.CONTROL, "status")
        seq: int = head["seq"]
        record = self._newest if self._presence.heard else None
        drives = record.drives if record else ()
        views = [translate.look(leg, record, stamp) for leg in record.legs] if record else []
        return wire.Status(
            **head,
            version=header.version if header else None,
            safety=self._safety(seq),
            drives=tuple(self._drive_state(drive, seq) for drive in drives),
            legs=tuple(translate.activity(view, seq) for view in views),
            events=tuple(self._events.history)[-STATUS_EVENT_COUNT:],
        )

    def _configuration(self) -> wire.Configuration:
        header = self._seam.header
        return wire.Configuration(
            **self._head(wire.CONTROL, "config"),
            version=header.version if header else None,
            trainer=self._trainer,
            listen=self._listen,
            period_ns=header.period_ns if header else None,
            drive_names=header.drive_names if header else (),
            leg_names=header.leg_names if header else (),
            config_hashes=header.config_hashes if header else {},
            robot=header.robot if header else {},
            limits=header.limits if header else {},
        )


def _next_due(due_ns: int, period_ns: int, now_ns: int) -> int:
    """The next due time, on the grid of `due_ns`; after a delay a period from now, so no bursts."""
    return due_ns + period_ns if due_ns + period_ns > now_ns else now_ns + period_ns
