"""One turn of the gateway's loop: records in, messages out; queries in, gateway state out.

The order within a turn: first read the new records and publish the estimates of the young ones
(`publish_estimates`). Then (`turn`) publish the records' other messages and their events; check for
the core's silence; take setpoints; take queries; answer what has an answer; send the gateway state;
publish the messages that are due once a second. Nothing here blocks, and the time is an argument.
"""

import logging
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple, Protocol

import msgspec
from gaitd_client import wire
from gaitd_names import EventCode, Mode, Outcome, ProgressCode, RefusalCode, Role
from gaitd_texts import Reader, catalogue

from daemon.config.settings import Lease
from daemon.gateway import events, requests, translate
from daemon.gateway.clients import ClientRefusedError, Clients, PlanStore
from daemon.gateway.emergencies import EmergencyHistory
from daemon.gateway.health import HealthWindow
from daemon.gateway.lease import LeaseManager
from daemon.gateway.lease_control import LeaseControl
from daemon.gateway.leg_messages import LegMessages
from daemon.gateway.outlet import Outlet
from daemon.gateway.presence import SILENCE_NS, Presence
from daemon.gateway.requests import Inquiry
from daemon.gateway.setpoints import NOTHING, Batch
from daemon.gateway.translate import Stamp
from daemon.ipc.record import CycleRecord, DriveRecord, GatewayState
from daemon.ipc.transport import RareNotice, RingError, RingHeader
from daemon.report_messages import refused
from daemon.system.clock import AgeClock
from daemon.wire.printable import printable

STATE_PERIOD_NS: Final = 20_000_000
DRIVES_PERIOD_NS: Final = 100_000_000
SECOND_NS: Final = 1_000_000_000
STATUS_EVENT_COUNT: Final = 20

_LOG_LEVEL: Final = {
    events.Priority.HIGH.value: logging.ERROR,
    events.Priority.MEDIUM.value: logging.WARNING,
    events.Priority.LOW.value: logging.INFO,
    events.Priority.INFO.value: logging.INFO,
}


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


class Waiting(NamedTuple):
    """A query whose answer is outstanding, and the name of its client."""

    inquiry: Inquiry
    client: str


class Gateway:
    """The gateway between the IPC channel and the outlet."""

    def __init__(
        self,
        ipc: CoreLink,
        outlet: Outlet,
        clock: AgeClock,
        trainer: str,
        listen: Sequence[str],
        lease: Lease,
        clients: Clients,
        plans: PlanStore,
        check_keys: Callable[[], str],
    ) -> None:
        """Begin without a core.

        Args:
            ipc: the channel to the core, or a recording (`playback.py`).
            outlet: publishes messages.
            clock: for ages.
            trainer: TRAINER in the keys.
            listen: endpoints, for the message `config`.
            lease: rules of the lease.
            clients: those that may connect.
            plans: the released plan.
            check_keys: reads the folder of keys as the next start will; returns why it cannot.
        """
        self._clients, self._plans, self._check_keys = clients, plans, check_keys
        self.restart_requested = False
        self._is_last_turn = False
        self._ipc, self._outlet, self._clock = ipc, outlet, clock
        self._trainer, self._listen = trainer, tuple(listen)
        self._log = logging.getLogger("gaitd.gateway")
        self._texts = catalogue(Reader.OPERATOR, "en")
        self._requests = requests.RequestQueue(first_state_seq=clock.now_ns())
        self.lease_control = LeaseControl(LeaseManager(lease))
        self._presence = Presence()
        self._events = events.EventLog()
        self._request_events = events.RequestEvents()
        self.health = HealthWindow()
        self._legs = LegMessages(outlet, clock, self.health)
        self.health.counters.setpoint_refused_count = self.lease_control.refused_count
        self._emergencies = EmergencyHistory()
        self._waiting: dict[int, Waiting] = {}
        self._ticket = 0
        self._boot_id = ""
        self._newest: CycleRecord | None = None
        self._fresh: list[CycleRecord] = []
        self._ring_error = ""
        self._failed, self._failed_count = RareNotice(), 0
        self._safety_published: tuple[object, ...] | None = None
        self._state_due_ns = self._drives_due_ns = 0
        self._second_due_ns = clock.now_ns() + SECOND_NS
        if plans.trouble:
            trouble = events.EventDraft(
                events.Priority.LOW,
                events.Kind.NOTE,
                EventCode.PLAN_UNREADABLE,
                said=plans.trouble,
            )
            self.publish_events([trouble])

    def publish_estimates(self, now_ns: int) -> bool:
        """Publish the estimates of new records; the rest of a turn can wait for a millisecond.

        Returns: whether there were new records.
        """
        records, header = self._records(), self._ipc.header
        if not records or header is None:
            return False
        self._fresh += records
        self._legs.publish_estimates(records, header.core_boot_id, now_ns)
        return True

    def turn(self, now_ns: int, inquiries: Sequence[Inquiry], batch: Batch = NOTHING) -> None:
        """One turn of the loop, after `publish_estimates`."""
        records, self._fresh = self._fresh, []
        self._receive(records, now_ns)
        if unread_count := self._ipc.take_unread():
            self.publish_events([events.unread(unread_count)])
        self.publish_events(self.lease_control.receive_setpoints(batch, now_ns))
        # A stop is handled before all other queries.
        for inquiry in sorted(inquiries, key=lambda one: one.name != "stop"):
            self._isolated(inquiry, lambda one=inquiry: self._receive_query(one, now_ns))
        self._settle(self._requests.tick(now_ns))
        self._settle(self._plans.answers())
        self.publish_events(self.lease_control.tick(now_ns))
        self.publish_events(self._request_events.tick(now_ns))
        self._publish_safety(now_ns)
        if records or inquiries or batch.arrivals or now_ns >= self._state_due_ns:
            self._state_due_ns = now_ns + STATE_PERIOD_NS
            self._send_state()
        if now_ns >= self._second_due_ns:
            self._second_due_ns = _next_due(self._second_due_ns, SECOND_NS, now_ns)
            seq = self._outlet.next_seq(wire.HEALTH)
            expiring = self._clients.expiring(self._clock.utc_ns())
            self._outlet.put(self.health.close(self._stamp(), seq, expiring), wire.HEALTH)

    def last_turn(self, now_ns: int, inquiries: Sequence[Inquiry], batch: Batch) -> None:
        """Read what had arrived when the loop ended: a stop counts, other requests are refused."""
        self._is_last_turn = True
        self.turn(now_ns, inquiries, batch)

    def _send_state(self) -> None:
        control = self.lease_control
        holder = control.leases.holder
        role = self._clients.role("acquire", holder) if holder else Role.DISPLAY
        gateway_state = self._requests.gateway_state(control.setpoints, control.lease, role)
        if gateway_state and not self._ipc.send(gateway_state) and self._presence.is_present:
            self.health.counters.gateway_state_dropped_count += 1

    def publish_events(self, drafts: Sequence[events.EventDraft]) -> None:
        """Publish events that do not come from a record of the core."""
        if drafts:
            self._publish(drafts, self._clock.utc_ns())

    def _publish_request(self, draft: events.EventDraft) -> None:
        self.publish_events(self._request_events.due(draft))

    @property
    def status(self) -> str:
        """One line for systemd's status."""
        record = self._newest if self._presence.is_present else None
        if record is None:
            return "no records from a core"
        return f"{self._texts.text(f'mode.{record.mode}')} [{record.mode}]"

    def close(self) -> None:
        """Answer the queries that still wait."""
        for ticket in tuple(self._waiting):
            answer = requests.Answer(ticket, Outcome.PENDING, refused(RefusalCode.GATEWAY_ENDS))
            self._settle([answer])

    # --- records ------------------------------------------------------------------------------

    def _records(self) -> list[CycleRecord]:
        try:
            records = self._ipc.records()
        except RingError as error:
            # Logged once: the file stays as it is until another core writes it.
            if str(error) != self._ring_error:
                self._ring_error = str(error)
                self._log.error("%s", error)
            return []
        self._ring_error = ""
        return records

    def _receive(self, records: Sequence[CycleRecord], now_ns: int) -> None:
        header = self._ipc.header
        if records and header:
            first_sight = self._newest is None or header.core_boot_id != self._boot_id
            back = not first_sight and not self._presence.is_present
            self._presence.record_received(now_ns)
            if first_sight:
                self._begin_core(header)
            self._legs.publish_others()
            for record in records:
                self._receive_record(record)
            if back:
                self.publish_events([events.CORE_BACK])
            # The newest record holds the outcomes of all stops and of the one request.
            self._settle(self._requests.receive(self._boot_id, records[-1]))
            self.publish_events(self.lease_control.receive_record(records[-1], now_ns))
            self._publish_drives(now_ns)
        elif self._presence.falls_silent(now_ns):
            self.publish_events([events.core_lost(SILENCE_NS // 1_000_000)])
            self._settle(self._requests.lose_core())
        self._outlet.set_alive(self._presence.is_present)

    def _begin_core(self, header: RingHeader) -> None:
        """Reset what belongs to the previous core: a record of a new core has arrived."""
        self._boot_id = header.core_boot_id
        self._newest = None
        self.publish_events(self.lease_control.begin_core(header.leg_names))
        self.health.core_started()
        self._emergencies.core_started()

    def _receive_record(self, record: CycleRecord) -> None:
        before, self._newest = self._newest, record
        if before is not None:
            self.health.counters.record_missed_count += max(record.seq - before.seq - 1, 0)
        self.health.add(record)
        self._emergencies.add(record)
        self._publish(events.new_events(before, record), record.sync_utc_ns)

    # --- messages -----------------------------------------------------------------------------

    def _stamp(self) -> Stamp:
        return translate.stamp_of(self._boot_id, self._newest) if self._newest else Stamp()

    def _head(self, *parts: str) -> dict[str, Any]:
        return translate.head(self._stamp(), self._outlet.next_seq(*parts))

    def _publish_drives(self, now_ns: int) -> None:
        if self._newest is None or now_ns < self._drives_due_ns:
            return
        self._drives_due_ns = _next_due(self._drives_due_ns, DRIVES_PERIOD_NS, now_ns)
        for drive in self._newest.drives:
            parts = ("drives", *drive.name.split("/"))
            message = self._drive_state(drive, self._outlet.next_seq(*parts))
            self._outlet.put(message, *parts)

    def _drive_state(self, drive: DriveRecord, seq: int) -> wire.DriveState:
        emergencies = self._emergencies.messages(drive.name)
        return translate.drive_state(drive, self._stamp(), seq, emergencies)

    def _publish_safety(self, now_ns: int) -> None:
        record = self._newest if self._presence.is_present else None
        holder = self.lease_control.leases.holder
        state = (record.mode, record.stage, record.verdict, holder) if record else ()
        # Published in the same turn as `health`, which sets the next due time after this.
        if state == self._safety_published and now_ns < self._second_due_ns:
            return
        self._safety_published = state
        self._outlet.put(self._safety(self._outlet.next_seq(wire.SAFETY)), wire.SAFETY)

    def _safety(self, seq: int) -> wire.Safety:
        header = self._ipc.header
        record = self._newest if self._presence.is_present else None
        limits, holder = header.limits if header else None, self.lease_control.leases.holder
        message = translate.safety(record, limits, self._stamp(), seq, holder)
        if record is None and self._ipc.starting:
            starts = wire.Progress(code=ProgressCode.CORE_STARTING, subject=None, values={})
            return msgspec.structs.replace(message, progress=starts)
        return message

    def _publish(self, drafts: Sequence[events.EventDraft], time_ns: int) -> None:
        record_seq = self._newest.seq if self._newest else 0
        made = self._events.add(
            drafts, self._stamp(), record_seq, time_ns, lambda: self._outlet.next_seq(wire.EVENTS)
        )
        for event in made:
            self._outlet.put_event(event)
            extra = {"event": event, "mode": self._newest and self._newest.mode}
            text = self._texts.event(event)
            self._log.log(_LOG_LEVEL[event.priority], "%s", text, extra=extra)

    # --- requests -----------------------------------------------------------------------------

    def _isolated(self, inquiry: Inquiry, act: Callable[[], None], *, answers: bool = True) -> None:
        """Run an action for one query; an exception in it is our bug and ends only that query."""
        try:
            act()
        except Exception as bug:  # noqa: BLE001 - reported; other queries are still served
            what = f"{type(bug).__name__}: {bug}"
            self._log.exception("control/%r has failed", inquiry.name)
            self._failed_count += 1
            if self._failed.due(self._failed_count):
                self.publish_events([events.failed(self._failed_count, what)])
            for ticket, waiting in tuple(self._waiting.items()):
                if waiting.inquiry is inquiry:
                    del self._waiting[ticket]
                    self._requests.withdraw(ticket)
            if answers:
                failed = refused(RefusalCode.GATEWAY_FAILED, what)
                self._isolated(inquiry, lambda: self._reject(inquiry, failed), answers=False)

    def _receive_query(self, inquiry: Inquiry, now_ns: int) -> None:
        route = requests.ROUTES.get(inquiry.name)
        if route is None:
            known = ", ".join(requests.ROUTES)
            self._reject(inquiry, refused(RefusalCode.NO_SUCH_REQUEST, known))
            return
        self._ticket += 1
        if route is requests.Route.STOP:
            # Counted first, before anything that could fail.
            self._requests.stop(self._ticket, now_ns)
        try:
            role = self._clients.role(inquiry.name, inquiry.identity)
        except ClientRefusedError as error:
            self._reject(inquiry, error.refusal)
            return
        try:
            payload = requests.decode_payload(inquiry.name, inquiry.payload)
        except requests.BadPayloadError as error:
            # A stop takes effect whatever its payload is.
            if route is not requests.Route.STOP:
                self._reject(inquiry, refused(RefusalCode.BAD_PAYLOAD, str(error)))
                return
            payload = wire.Ask()
        if self._clients.have_keys:
            # An authenticated name replaces the claimed one, in events and the lease.
            name = inquiry.identity or events.claimed(payload.client)
            payload = msgspec.structs.replace(payload, client=name)
        self._waiting[self._ticket] = Waiting(inquiry, payload.client)
        self._route(route, inquiry.name, payload, role, now_ns)

    def _route(
        self, route: requests.Route, name: str, payload: wire.Ask, role: Role, now_ns: int
    ) -> None:
        ticket = self._ticket
        match route:
            case requests.Route.STOP:
                self.publish_events(self.lease_control.stop())
            case requests.Route.CORE:
                plan = self._plans.plan
                if self.restart_requested or self._is_last_turn:
                    answer = requests.Answer(ticket, Outcome.REFUSED, self._ending())
                elif not self._presence.is_present and self._ipc.starting:
                    starts = refused(RefusalCode.CORE_STARTING)
                    answer = requests.Answer(ticket, Outcome.REFUSED, starts)
                else:
                    answer = self._requests.submit(ticket, name, payload, now_ns, role, plan)
                if answer is None:
                    self._publish_request(events.request_sent(name, payload.client))
                else:
                    self._settle([answer])
            case requests.Route.LEASE:
                self._lease(payload, now_ns)
            case requests.Route.REPORT:
                if isinstance(payload, wire.ReportAsk):
                    self._report(payload)
            case requests.Route.GATEWAY:
                self._waiting.pop(ticket).inquiry.answer(self._information(name))
            case requests.Route.PLAN:
                if isinstance(payload, wire.PlanAsk):
                    draft = self._plans.release(ticket, payload.plan, payload.client)
                    self.publish_events([draft])
            case requests.Route.RESTART:
                self._settle([self._restart(ticket)])

    def _restart(self, ticket: int) -> requests.Answer:
        """Refuse a restart that would stop the machine, or after which no gateway could start."""
        record = self._newest  # also of a core that is silent now: it may be moving the machine
        if record and (record.mode.active or record.mode is Mode.STOPPING):
            why = refused(RefusalCode.WOULD_STOP, mode_now=record.mode)
        elif self._requests.is_waiting:
            why = refused(RefusalCode.ANSWER_OUTSTANDING)
        elif trouble := self._check_keys():
            why = refused(RefusalCode.KEYS_UNUSABLE, trouble)
        else:
            self.restart_requested = True
            return requests.Answer(ticket, Outcome.DONE)
        return requests.Answer(ticket, Outcome.REFUSED, why)

    def _ending(self) -> wire.Refusal:
        restarts = self.restart_requested
        return refused(RefusalCode.GATEWAY_RESTARTS if restarts else RefusalCode.GATEWAY_ENDS)

    @property
    def may_end(self) -> bool:
        """True if a restart was requested, and every stop that came since has its answer."""
        return self.restart_requested and not self._requests.is_waiting

    def _lease(self, payload: wire.Ask, now_ns: int) -> None:
        """Grant, renew or end the lease; its number is sent only to the client of the query."""
        inquiry, client = self._waiting.pop(self._ticket)
        mode = self._newest.mode if self._newest and self._presence.is_present else None
        decision = self.lease_control.decide(payload, mode, now_ns)
        if mode is None and decision.outcome is Outcome.REFUSED and self._ipc.starting:
            decision = decision._replace(refusal=refused(RefusalCode.CORE_STARTING))
        reply = self._reply(inquiry.name, decision.outcome, decision.refusal)
        lease = {"lease": decision.number, "lease_duration_ms": decision.duration_ms}
        inquiry.answer(msgspec.structs.replace(reply, **lease))
        if not decision.renewed:
            outcome = decision.outcome
            draft = events.request_answered(inquiry.name, client, outcome, decision.refusal)
            self._publish_request(draft)

    def _report(self, report: wire.ReportAsk) -> None:
        """Publish the state of the lease's holder; it comes with each stride, so it is no event."""
        inquiry, client = self._waiting.pop(self._ticket)
        refusal = self.lease_control.refuse_report(report)
        if refusal is None:
            parts = (report.leg, wire.CONTROLLER)
            message = wire.ControllerState(
                **self._head(*parts),
                leg=report.leg,
                client=client,
                for_cycle=report.for_cycle,
                values=report.values,
                hip=report.hip,
                slide=report.slide,
            )
            self._outlet.put(message, *parts)
        outcome = Outcome.DONE if refusal is None else Outcome.REFUSED
        inquiry.answer(self._reply(inquiry.name, outcome, refusal))

    def _settle(self, answers: Sequence[requests.Answer]) -> None:
        """Send answers, and publish the outcomes of requests as events."""
        for answer in answers:
            waiting = self._waiting.pop(answer.ticket, None)
            # A query that has failed does not wait any more.
            if waiting is not None:
                self._isolated(
                    waiting.inquiry,
                    lambda answer=answer, waiting=waiting: self._answer(answer, waiting),
                )

    def _answer(self, answer: requests.Answer, waiting: Waiting) -> None:
        inquiry, outcome = waiting.inquiry, answer.outcome
        inquiry.answer(self._reply(inquiry.name, answer.outcome, answer.refusal))
        if not answer.by_core:
            draft = events.request_answered(inquiry.name, waiting.client, outcome, answer.refusal)
            self._publish_request(draft)

    def _reject(self, inquiry: Inquiry, refusal: wire.Refusal) -> None:
        inquiry.answer(self._reply(inquiry.name, Outcome.REFUSED, refusal), failed=True)
        name = printable(inquiry.name)
        self._log.warning("control/%s refused: %s", name, self._texts.refusal(refusal))

    def _reply(self, name: str, outcome: Outcome, refusal: wire.Refusal | None) -> wire.Reply:
        record = self._newest if self._presence.is_present else None
        return wire.Reply(
            # Unknown names share one counter, so that clients cannot create counters at will.
            **self._head(wire.CONTROL, name if name in requests.ROUTES else ""),
            request=name,
            outcome=outcome,
            refusal=refusal,
            mode=record.mode if record else None,
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
        header, stamp = self._ipc.header, self._stamp()
        head = self._head(wire.CONTROL, "status")
        seq: int = head["seq"]
        record = self._newest if self._presence.is_present else None
        drives = record.drives if record else ()
        views = [translate.view_of(leg, record, stamp) for leg in record.legs] if record else []
        return wire.Status(
            **head,
            version=header.version if header else None,
            safety=self._safety(seq),
            drives=tuple(self._drive_state(drive, seq) for drive in drives),
            legs=tuple(translate.activity(view, seq) for view in views),
            events=tuple(self._events.history)[-STATUS_EVENT_COUNT:],
            plan=self._plans.limits,
        )

    def _configuration(self) -> wire.Configuration:
        header = self._ipc.header
        return wire.Configuration(
            **self._head(wire.CONTROL, "config"),
            version=header.version if header else None,
            trainer=self._trainer,
            listen=self._listen,
            period_ns=header.period_ns if header else None,
            drive_names=header.drive_names if header else (),
            leg_names=header.leg_names if header else (),
            joints=wire.JOINTS,
            config_hashes=header.config_hashes if header else {},
            robot=header.robot if header else {},
            limits=header.limits if header else {},
            keys=self._clients.have_keys,
            keys_expiring=self._clients.expiring(self._clock.utc_ns()),
            links=tuple(self._clients.link(*link) for link in self._outlet.links()),
        )


def _next_due(due_ns: int, period_ns: int, now_ns: int) -> int:
    """The next due time, on the grid of `due_ns`; after a delay a period from now, so no bursts."""
    return due_ns + period_ns if due_ns + period_ns > now_ns else now_ns + period_ns
