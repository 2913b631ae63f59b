"""Queries to control/NAME: where each is answered, and the one answer that each gets."""

import logging
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import msgspec
from gaitd_client import wire
from gaitd_names import Mode, Outcome, RefusalCode, Role
from gaitd_texts import Reader, catalogue

from daemon.gateway import events, requests, translate
from daemon.gateway.clients import ClientRefusedError, Clients, PlanStore
from daemon.gateway.core_view import CoreView
from daemon.gateway.events import EventLog
from daemon.gateway.lease_control import LeaseControl
from daemon.gateway.outlet import Outlet
from daemon.gateway.requests import Answer, Inquiry, RequestQueue, Route
from daemon.ipc.transport import RareNotice
from daemon.report_messages import refused
from daemon.wire.printable import printable


class Ending:
    """The end of this gateway, on which requests are refused: a restart, or that of the process."""

    def __init__(self, core: CoreView, queue: RequestQueue, check_keys: Callable[[], str]) -> None:
        self._core, self._queue, self._check_keys = core, queue, check_keys
        self.restart_requested = False
        self.is_last_turn = False

    def request_restart(self) -> wire.Refusal | None:
        """Refuse a restart that would stop the machine, or after which no gateway could start."""
        record = self._core.newest  # also of a silent core: it may be moving the machine
        if record and (record.mode.active or record.mode is Mode.STOPPING):
            return refused(RefusalCode.WOULD_STOP, mode_now=record.mode)
        if self._queue.is_waiting:
            return refused(RefusalCode.ANSWER_OUTSTANDING)
        if trouble := self._check_keys():
            return refused(RefusalCode.KEYS_UNUSABLE, trouble)
        self.restart_requested = True
        return None

    @property
    def may_end(self) -> bool:
        """True if a restart was requested, and every stop that came since has its answer."""
        return self.restart_requested and not self._queue.is_waiting

    @property
    def refusal(self) -> wire.Refusal | None:
        """Why no request is sent to the core any more; None while this gateway goes on."""
        if self.restart_requested:
            return refused(RefusalCode.GATEWAY_RESTARTS)
        return refused(RefusalCode.GATEWAY_ENDS) if self.is_last_turn else None


class Waiting(NamedTuple):
    """A query whose answer is outstanding, and the name of its client."""

    inquiry: Inquiry
    client: str


class Control:
    """The queries of clients, and those that wait for an answer."""

    def __init__(
        self,
        outlet: Outlet,
        core: CoreView,
        event_log: EventLog,
        queue: RequestQueue,
        leases: LeaseControl,
        clients: Clients,
        plans: PlanStore,
        ending: Ending,
        inform: Callable[[str, dict[str, Any]], msgspec.Struct],
    ) -> None:
        """Begin without a query.

        Args:
            outlet: publishes the states of controllers.
            core: its mode is part of every answer.
            event_log: publishes events about requests.
            queue: requests for the core.
            leases: the lease.
            clients: those that may request.
            plans: the released plan.
            ending: the end of this gateway.
            inform: makes the answer to a query that only reads, from its name and head.
        """
        self._outlet, self._core, self._events = outlet, core, event_log
        self._queue, self._leases, self._plans = queue, leases, plans
        self._clients, self._ending, self._inform = clients, ending, inform
        self._log = logging.getLogger("gaitd.gateway")
        self._waiting: dict[int, Waiting] = {}
        self._ticket = 0
        self._marks = events.MarkBudget()
        self._failed, self._failed_count = RareNotice(), 0

    def receive(self, inquiries: Sequence[Inquiry], now_ns: int) -> None:
        """Take queries; a stop is handled before all others."""
        for inquiry in sorted(inquiries, key=lambda one: one.name != "stop"):
            self._isolated(inquiry, lambda one=inquiry: self._receive(one, now_ns))

    def settle(self, answers: Sequence[Answer]) -> None:
        """Send answers, and publish the outcomes of requests as events."""
        for answer in answers:
            waiting = self._waiting.pop(answer.ticket, None)
            # A query that has failed does not wait any more.
            if waiting is not None:
                self._isolated(
                    waiting.inquiry,
                    lambda answer=answer, waiting=waiting: self._answer(answer, waiting),
                )

    def close(self) -> None:
        """Answer the queries that still wait."""
        ends = refused(RefusalCode.GATEWAY_ENDS)
        self.settle([Answer(ticket, Outcome.PENDING, ends) for ticket in self._waiting])

    def _isolated(self, inquiry: Inquiry, act: Callable[[], None], *, answers: bool = True) -> None:
        """Run an action for one query; an exception in it is our bug and ends only that query."""
        try:
            act()
        except Exception as bug:  # noqa: BLE001 - reported; other queries are still served
            what = f"{type(bug).__name__}: {bug}"
            self._log.exception("control/%r has failed", inquiry.name)
            self._failed_count += 1
            if self._failed.due(self._failed_count):
                self._events.publish([events.failed(self._failed_count, what)])
            for ticket, waiting in tuple(self._waiting.items()):
                if waiting.inquiry is inquiry:
                    del self._waiting[ticket]
                    self._queue.withdraw(ticket)
            if answers:
                failed = refused(RefusalCode.GATEWAY_FAILED, what)
                self._isolated(inquiry, lambda: self._reject(inquiry, failed), answers=False)

    def _receive(self, inquiry: Inquiry, now_ns: int) -> None:
        route = requests.ROUTES.get(inquiry.name)
        if route is None:
            known = ", ".join(requests.ROUTES)
            self._reject(inquiry, refused(RefusalCode.NO_SUCH_REQUEST, known))
            return
        self._ticket += 1
        if route is Route.STOP:
            # Counted first, before anything that could fail.
            self._queue.stop(self._ticket, now_ns)
        try:
            role = self._clients.role(inquiry.name, inquiry.identity)
        except ClientRefusedError as error:
            self._reject(inquiry, error.refusal)
            return
        try:
            payload = requests.decode_payload(inquiry.name, inquiry.payload)
        except requests.BadPayloadError as error:
            # A stop takes effect whatever its payload is.
            if route is not Route.STOP:
                self._reject(inquiry, refused(RefusalCode.BAD_PAYLOAD, str(error)))
                return
            payload = wire.Ask()
        if self._clients.have_keys:
            # An authenticated name replaces the claimed one, in events and the lease.
            name = inquiry.identity or events.claimed(payload.client)
            payload = msgspec.structs.replace(payload, client=name)
        self._waiting[self._ticket] = Waiting(inquiry, payload.client)
        self._route(route, inquiry.name, payload, role, now_ns)

    def _route(self, route: Route, name: str, payload: wire.Ask, role: Role, now_ns: int) -> None:
        ticket = self._ticket
        match route:
            case Route.STOP:
                self._events.publish(self._leases.stop())
            case Route.CORE:
                self._submit(name, payload, role, now_ns)
            case Route.LEASE:
                self._lease(payload, now_ns)
            case Route.REPORT:
                if isinstance(payload, wire.ReportAsk):
                    self._report(payload)
            case Route.GATEWAY:
                self._waiting.pop(ticket).inquiry.answer(self._inform(name, self._head(name)))
            case Route.PLAN:
                if isinstance(payload, wire.PlanAsk):
                    draft = self._plans.release(ticket, payload.plan, payload.client)
                    self._events.publish([draft])
            case Route.MARK:
                if isinstance(payload, wire.MarkAsk):
                    self._mark(payload, now_ns)
            case Route.RESTART:
                why = self._ending.request_restart()
                self.settle([Answer(ticket, Outcome.REFUSED if why else Outcome.DONE, why)])

    def _submit(self, name: str, payload: wire.Ask, role: Role, now_ns: int) -> None:
        """Send a request to the core, or refuse it."""
        why = self._ending.refusal
        if why is None and not self._core.is_present and self._core.link.starting:
            why = refused(RefusalCode.CORE_STARTING)
        if why is None:
            plan = self._plans.plan
            answer = self._queue.submit(self._ticket, name, payload, now_ns, role, plan)
        else:
            answer = Answer(self._ticket, Outcome.REFUSED, why)
        if answer is None:
            self._events.publish_request(events.request_sent(name, payload.client))
        else:
            self.settle([answer])

    def _lease(self, payload: wire.Ask, now_ns: int) -> None:
        """Grant, renew or end the lease; its number is sent only to the client of the query."""
        inquiry, client = self._waiting.pop(self._ticket)
        record = self._core.record
        decision = self._leases.decide(payload, record.mode if record else None, now_ns)
        is_refused = decision.outcome is Outcome.REFUSED
        if record is None and is_refused and self._core.link.starting:
            decision = decision._replace(refusal=refused(RefusalCode.CORE_STARTING))
        reply = self._reply(inquiry.name, decision.outcome, decision.refusal)
        lease = {"lease": decision.number, "lease_duration_ms": decision.duration_ms}
        inquiry.answer(msgspec.structs.replace(reply, **lease))
        if not decision.renewed:
            outcome = decision.outcome
            draft = events.request_answered(inquiry.name, client, outcome, decision.refusal)
            self._events.publish_request(draft)

    def _report(self, report: wire.ReportAsk) -> None:
        """Publish the state of the lease's holder; it comes with each stride, so it is no event."""
        inquiry, client = self._waiting.pop(self._ticket)
        refusal = self._leases.refuse_report(report)
        if refusal is None:
            parts = (report.leg, wire.CONTROLLER)
            message = wire.ControllerState(
                **translate.head(self._core.stamp, self._outlet.next_seq(*parts)),
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

    def _mark(self, mark: wire.MarkAsk, now_ns: int) -> None:
        """Publish a mark; its event says that it is done, so there is no other one."""
        refusal = self._marks.take(now_ns)
        if refusal is not None:
            self.settle([Answer(self._ticket, Outcome.REFUSED, refusal)])
            return
        inquiry, client = self._waiting.pop(self._ticket)
        self._events.publish([events.mark(client, mark.text)])
        inquiry.answer(self._reply(inquiry.name, Outcome.DONE, None))

    def _answer(self, answer: requests.Answer, waiting: Waiting) -> None:
        inquiry, outcome = waiting.inquiry, answer.outcome
        inquiry.answer(self._reply(inquiry.name, answer.outcome, answer.refusal))
        if not answer.by_core:
            draft = events.request_answered(inquiry.name, waiting.client, outcome, answer.refusal)
            self._events.publish_request(draft)

    def _reject(self, inquiry: Inquiry, refusal: wire.Refusal) -> None:
        inquiry.answer(self._reply(inquiry.name, Outcome.REFUSED, refusal), failed=True)
        name = printable(inquiry.name)
        text = catalogue(Reader.OPERATOR, "en").refusal(refusal)
        self._log.warning("control/%s refused: %s", name, text)

    def _reply(self, name: str, outcome: Outcome, refusal: wire.Refusal | None) -> wire.Reply:
        record = self._core.record
        return wire.Reply(
            **self._head(name),
            request=name,
            outcome=outcome,
            refusal=refusal,
            mode=record.mode if record else None,
        )

    def _head(self, name: str) -> dict[str, Any]:
        # Unknown names share one counter, so that clients cannot create counters at will.
        seq = self._outlet.next_seq(wire.CONTROL, name if name in requests.ROUTES else "")
        return translate.head(self._core.stamp, seq)
