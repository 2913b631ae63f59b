"""Requests of clients: one outstanding at a time, and stops, which never wait.

    acquire release            the gateway answers at once: `lease.py`
    status config schema       the gateway answers at once
    plan                       the gateway answers at once: `clients.py`
    mark                       the gateway publishes it as an event at once
    restart                    the gateway answers at once, and starts anew; refused unless nothing
                               moves and no answer is outstanding
    stop                       counts up at once; answered when a record shows the count
    enable disable reset mode  one of them is outstanding; a second one is refused as busy

Ends of an outstanding request:

    a record shows its outcome           done or refused, with the core's reason
    the core has another boot id         refused: the new core does not know the request
    no records arrive, or the time       pending: the outcome is unknown; the request is removed
    is over                              from the gateway state, so a core that resumes late
                                         does not receive it

Stop counts: the gateway state carries `stop_count`; any increase stops. The count never falls. A
gateway that has just started sends no state before it has read the core's count and continues
from there: a smaller one would hide the next stop, a larger one would be a stop. Only a stop
requested before that is sent at once, and again above the core's count when that is known.
"""

from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple, Protocol

import msgspec
from gaitd_client import wire
from gaitd_names import Mode, Outcome, RefusalCode, RequestKind, Role

from daemon.ipc.decoding import Decoder, RefusedError
from daemon.ipc.record import CycleRecord, GatewayState, ModeRequest, Plan, Request, Setpoint
from daemon.report_messages import refusal_message, refused


class Route(Enum):
    """Where a query to control/NAME is answered."""

    LEASE = "lease"
    REPORT = "report"
    GATEWAY = "gateway"
    STOP = "stop"
    CORE = "core"
    PLAN = "plan"
    MARK = "mark"
    RESTART = "restart"


ROUTES: Final[dict[str, Route]] = {
    "acquire": Route.LEASE,
    "release": Route.LEASE,
    "report": Route.REPORT,
    "enable": Route.CORE,
    "disable": Route.CORE,
    "stop": Route.STOP,
    "reset": Route.CORE,
    "mode": Route.CORE,
    "status": Route.GATEWAY,
    "config": Route.GATEWAY,
    "schema": Route.GATEWAY,
    "plan": Route.PLAN,
    "mark": Route.MARK,
    "restart": Route.RESTART,
}

PAYLOADS: Final[dict[str, type[wire.Ask]]] = {
    "mode": wire.ModeAsk,
    "acquire": wire.AcquireAsk,
    "release": wire.ReleaseAsk,
    "report": wire.ReportAsk,
    "plan": wire.PlanAsk,
    "mark": wire.MarkAsk,
}
"""Payload types of queries that carry more than the client's name."""

_DECODERS: Final = {
    kind: Decoder(msgspec.json.Decoder(kind).decode) for kind in (wire.Ask, *PAYLOADS.values())
}

TIMEOUT_NS: Final[dict[RequestKind, int]] = {
    RequestKind.ENABLE: 8_000_000_000,
    RequestKind.DISABLE: 5_000_000_000,
    RequestKind.RESET: 5_000_000_000,
    RequestKind.MODE: 5_000_000_000,
}
"""Time limits for an answer, below the 10 s after which Zenoh gives up a query by default."""

QUERY_SIZE_MAX: Final = 4096
"""Maximum size of a query's payload in bytes."""

STOP_TIMEOUT_NS: Final = 500_000_000


class Inquiry(Protocol):
    """A query to control/NAME that waits for its only answer."""

    name: str
    identity: str
    """Authenticated name of the client, from the key; empty if the key has none."""
    payload: bytes

    def answer(self, message: msgspec.Struct, *, failed: bool = False) -> None:
        """Send the reply and finish the query."""
        ...


class Answer(NamedTuple):
    """The answer to the query that `ticket` stands for."""

    ticket: int
    outcome: Outcome
    refusal: wire.Refusal | None = None
    """Why it is not done."""
    by_core: bool = False
    """True if the core decided the outcome and reports it in its own events."""


class BadPayloadError(Exception):
    """The payload of a query is not valid for its name; the message gives the reason."""


def decode_payload(name: str, payload: bytes) -> wire.Ask:
    """Decode the payload of a query to control/NAME strictly; an empty payload means `{}`.

    Raises:
        BadPayloadError: no JSON, an unknown or missing field, a value out of range.
    """
    if len(payload) > QUERY_SIZE_MAX:
        raise BadPayloadError(f"more than {QUERY_SIZE_MAX} bytes")
    kind = PAYLOADS.get(name, wire.Ask)
    try:
        return _DECODERS[kind].decode(payload or b"{}")
    except RefusedError as error:
        known = ", ".join(item.encode_name for item in msgspec.structs.fields(kind))
        what = str(error).replace(f"matching regex {wire.ONE_LINE!r}", "without control characters")
        raise BadPayloadError(f"{what}; known fields: {known}") from error


def mode_request(payload: wire.Ask) -> ModeRequest:
    """The arguments of RequestKind.MODE; defaults for a request that has none."""
    if not isinstance(payload, wire.ModeAsk):
        return ModeRequest()
    return ModeRequest(
        mode=Mode(payload.mode),
        cadence_hz=payload.cadence_hz,
        amplitude_ratio=payload.amplitude_ratio,
        duration_s=payload.duration_s,
        scenario=payload.scenario,
        axis=payload.axis,
        witnessed=payload.witnessed,
        baseline=payload.baseline,
    )


@dataclass(slots=True)
class _Stop:
    ticket: int
    count: int
    deadline_ns: int


@dataclass(slots=True)
class _Pending:
    ticket: int
    name: str
    request: Request
    deadline_ns: int


@dataclass(slots=True)
class RequestQueue:
    """Keeps the gateway state and the queries that wait for an answer; uses no Zenoh, no clock."""

    first_state_seq: int = 0
    """First sequence number of the gateway state. The core accepts only rising numbers, so a later
    gateway must begin higher than this one ended; the time in ns does."""

    _state_seq: int = 0
    _boot_id: str = ""
    _cycle: int = 0
    _core_present: bool = False
    _stop_count: int = 0
    _request_id: int = 0
    _pending: _Pending | None = None
    _stops: list[_Stop] = field(default_factory=list)

    def receive(self, core_boot_id: str, record: CycleRecord) -> list[Answer]:
        """Update stops and requests from a record, and return the answers that are due."""
        answers = self._begin_core(core_boot_id, record) if core_boot_id != self._boot_id else []
        self._core_present = True
        self._cycle = record.cycle
        self._stop_count = max(self._stop_count, record.stop_count)
        self._request_id = max(self._request_id, record.request.id)
        return answers + self._confirmed_stops(record) + self._outcome(record)

    def lose_core(self) -> list[Answer]:
        """Answer the outstanding request after the core's records have stopped."""
        self._core_present = False
        return self._answer_pending(Outcome.PENDING, refused(RefusalCode.OUTCOME_UNKNOWN))

    def submit(
        self,
        ticket: int,
        name: str,
        payload: wire.Ask,
        now_ns: int,
        role: Role = Role.DISPLAY,
        plan: Plan | None = None,
    ) -> Answer | None:
        """Accept a request for the core; returns None while its answer is outstanding."""
        if not self._core_present:
            return Answer(ticket, Outcome.REFUSED, refused(RefusalCode.CORE_SILENT))
        if self._pending:
            busy = refused(RefusalCode.BUSY, open_request=self._pending.name)
            return Answer(ticket, Outcome.REFUSED, busy)
        mode = mode_request(payload)
        kind = RequestKind(name)
        self._request_id += 1
        for_cycle = self._cycle if payload.for_cycle is None else payload.for_cycle
        request = Request(self._request_id, kind, for_cycle, mode, role, plan)
        self._pending = _Pending(ticket, name, request, now_ns + TIMEOUT_NS[kind])
        return None

    def stop(self, ticket: int, now_ns: int) -> None:
        """Count a stop, whatever else is outstanding; the next gateway state carries it."""
        self._stop_count += 1
        self._stops.append(_Stop(ticket, self._stop_count, now_ns + STOP_TIMEOUT_NS))

    @property
    def is_waiting(self) -> bool:
        """True if a request or a stop has no answer yet."""
        return self._pending is not None or bool(self._stops)

    def withdraw(self, ticket: int) -> None:
        """Remove the request of a query that has failed; stops are never removed."""
        if self._pending and self._pending.ticket == ticket:
            self._pending = None

    def tick(self, now_ns: int) -> list[Answer]:
        """Answer requests and stops whose time limit is over."""
        late = [stop for stop in self._stops if now_ns >= stop.deadline_ns]
        self._stops = [stop for stop in self._stops if now_ns < stop.deadline_ns]
        unconfirmed = refused(RefusalCode.STOP_UNCONFIRMED)
        answers = [Answer(stop.ticket, Outcome.PENDING, unconfirmed) for stop in late]
        if self._pending and now_ns >= self._pending.deadline_ns:
            unknown = refused(RefusalCode.OUTCOME_UNKNOWN)
            answers += self._answer_pending(Outcome.PENDING, unknown)
        return answers

    def gateway_state(
        self,
        setpoints: tuple[Setpoint, ...] = (),
        lease: int = 0,
        lease_role: Role = Role.DISPLAY,
    ) -> GatewayState | None:
        """The next gateway state; None before a core is known, unless a stop is requested.

        Args:
            setpoints: the newest of each leg.
            lease: the lease that is held; 0: none.
            lease_role: role of its holder.
        """
        if not self._boot_id and not self._stops:
            return None
        self._state_seq += 1
        return GatewayState(
            core_boot_id=self._boot_id,
            seq=self.first_state_seq + self._state_seq,
            for_cycle=self._cycle,
            stop_count=self._stop_count,
            request=self._pending.request if self._pending else Request(),
            setpoints=setpoints,
            lease=lease,
            lease_role=lease_role,
        )

    def _begin_core(self, core_boot_id: str, record: CycleRecord) -> list[Answer]:
        """Take over the counts of the first core or of a restarted one."""
        self._boot_id = core_boot_id
        self._request_id = record.request.id
        if self._stops:
            self._stop_count = max(self._stop_count, record.stop_count + 1)
        for stop in self._stops:
            stop.count = self._stop_count
        return self._answer_pending(Outcome.REFUSED, refused(RefusalCode.CORE_RESTARTED))

    def _confirmed_stops(self, record: CycleRecord) -> list[Answer]:
        confirmed = [stop for stop in self._stops if record.stop_count >= stop.count]
        self._stops = [stop for stop in self._stops if record.stop_count < stop.count]
        return [Answer(stop.ticket, Outcome.DONE) for stop in confirmed]

    def _outcome(self, record: CycleRecord) -> list[Answer]:
        waiting, result = self._pending, record.request
        if waiting is None or result.id != waiting.request.id or result.outcome is Outcome.PENDING:
            return []
        refusal = None if result.refusal is None else refusal_message(result.refusal)
        answers = self._answer_pending(result.outcome, refusal)
        return [answer._replace(by_core=True) for answer in answers]

    def _answer_pending(self, outcome: Outcome, refusal: wire.Refusal | None) -> list[Answer]:
        waiting, self._pending = self._pending, None
        return [Answer(waiting.ticket, outcome, refusal)] if waiting else []
