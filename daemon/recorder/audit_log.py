"""The request log: each request with its outcome, and the machine's modes and verdicts.

Every query to control/* that requests an action is logged with its client, payload, outcome and
reason; `status`, `config` and `schema` only read. Kinds of lines (fields: docs/black_box.md):

    start, end           of a gateway
    core                 a core was found, or its records stopped
    mode, verdict        changes of mode and verdict
    asked                a query that has no answer at the end of the turn in which it came
    answered             its answer, by `ticket`; or query and answer in one line
    summed               a count of lines that were too frequent to be written singly
    lost                 lines that a slow disk had no room for

Limits. Refusals, stops and queries without an answer yet get LINES_PER_MINUTE lines each in a
minute; the rest is counted by name, client and outcome and written as one line after it, so that a
flood of queries cannot displace older lines. Requests to the core and its decisions are never
summed up: there is one such request at a time. The renewal of a lease is not logged.

A line is written and synced by another thread, usually within milliseconds: nothing waits for it,
least of all a stop. A power cut loses at most the lines of the last second. The number of a lease
is its holder's secret and never in the log.
"""

import contextlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import msgspec
from gaitd_client import wire
from gaitd_names import EventCode

from daemon.gateway.events import claimed
from daemon.gateway.requests import ROUTES, Inquiry, Route
from daemon.ipc.decoding import RefusedError
from daemon.ipc.record import Verdict
from daemon.recorder.audit_file import ANYTHING, RequestFile, fields_of, files_of
from daemon.recorder.disk import Disk
from daemon.recorder.ring_follower import RecordHeader, identity

LINES_PER_MINUTE: Final = 20
MINUTE_NS: Final = 60_000_000_000
RETRY_NS: Final = 1_000_000_000
SUMMED_MAX: Final = 20
"""Different sums in a minute; further ones are counted as "others"."""
NAME_LENGTH_MAX: Final = 64
WHAT: Final = "request log"
DONE: Final = "done"
REFUSED: Final = "refused"
UNANSWERED: Final = "unanswered"
SECRET: Final = "..."


@dataclass(slots=True, eq=False)
class LoggedQuery:
    """A query with its log entry; forwards the answer and logs it."""

    inquiry: Inquiry
    log: "RequestLog"
    ticket: int
    name: str
    identity: str
    payload: bytes
    fields: dict[str, Any]
    turn_ended: bool = False
    """True if a turn has ended without an answer to it."""
    written: bool = False
    """True if a line of it is in the log."""

    @property
    def renews(self) -> bool:
        """True if the payload names a lease that the client holds already."""
        payload = self.fields["payload"]
        return isinstance(payload, dict) and "lease" in payload

    def answer(self, message: msgspec.Struct, *, failed: bool = False) -> None:
        """As `Inquiry.answer`."""
        self.inquiry.answer(message, failed=failed)
        if isinstance(message, wire.Reply):
            self.log.answered(self, message)


class RequestLog:
    """Makes the lines of the log; never waits and never raises. The time is an argument."""

    def __init__(
        self,
        file: RequestFile,
        disk: Disk,
        utc_ns: int,
        version: str,
        have_keys: bool = False,
        computer_boot_id: str = "",
    ) -> None:
        """Write the first line of this gateway; `have_keys`: names in payloads are only claimed."""
        self._file, self._disk, self._utc_ns = file, disk, utc_ns
        self._have_keys = have_keys
        self._boot_id, self._cycle = "", 0
        self._newest: RecordHeader | None = None
        self._ticket = 0
        self._open: dict[int, LoggedQuery] = {}
        self._budget: Counter[str] = Counter()
        self._summed: Counter[tuple[str, str, str]] = Counter()
        self._minute_ns = self._flush_due_ns = 0
        self._flushing = self._flush_failed = False
        self.lost_count = 0
        self._lost_logged = 0
        self._write("start", version=version, computer_boot_id=computer_boot_id)

    # --- events to log --------------------------------------------------------------------------

    def wrap(self, inquiries: Sequence[Inquiry], utc_ns: int) -> list[Inquiry]:
        """Wrap queries on their way to the service, so that their answers are logged."""
        self._utc_ns = utc_ns
        return [self._wrapped(inquiry) for inquiry in inquiries]

    def answered(self, query: LoggedQuery, reply: wire.Reply) -> None:
        """Log the answer to a query."""
        self._open.pop(query.ticket, None)
        if query.name == "acquire" and query.renews and reply.outcome == DONE:
            return
        stop = ROUTES.get(query.name) is Route.STOP
        if (stop or reply.outcome == REFUSED) and not query.written:
            kind = "stop" if stop else REFUSED
            if not self._has_budget(kind, query, reply.outcome):
                return
        answer = {"outcome": reply.outcome, "refusal": reply.refusal, "mode": reply.mode}
        known = {"name": query.name[:NAME_LENGTH_MAX], "client": query.fields.get("client")}
        payload = {} if query.written else {"payload": query.fields["payload"]}
        self._write("answered", ticket=query.ticket, **known, **payload, **answer)

    def core(self, boot_id: str, present: bool) -> None:
        """Log that a core was found, or that its records stopped or arrive again."""
        if boot_id != self._boot_id:
            self._boot_id, self._newest = boot_id, None
        self._write("core", heard=present)

    def record(self, header: RecordHeader) -> None:
        """Log the changes of mode and verdict since the record before."""
        before, self._newest, self._cycle = self._newest, header, header.cycle
        if before is None or before.mode != header.mode:
            self._write("mode", mode=header.mode)
        latched = before.verdict if before else Verdict()
        now = header.verdict
        if identity(latched) != identity(now):
            what = {"cause": now.cause, "category": now.category, "drive": now.drive}
            self._write("verdict", **what, finding=now.finding, said=now.said)

    def turn(self, now_ns: int, utc_ns: int) -> None:
        """End a turn: log unanswered queries, write the sums once a minute, start a flush."""
        self._utc_ns = utc_ns
        for query in self._open.values():
            if query.turn_ended:
                continue
            query.turn_ended = True
            query.written = self._has_budget("asked", query, UNANSWERED)
            if query.written:
                self._write(
                    "asked", ticket=query.ticket, name=query.name[:NAME_LENGTH_MAX], **query.fields
                )
        if now_ns - self._minute_ns >= MINUTE_NS:
            self._minute_ns = now_ns
            self._sum_up()
        if self._flush_failed:
            self._flush_failed, self._flush_due_ns = False, now_ns + RETRY_NS
        if self._file.waits and not self._flushing and now_ns >= self._flush_due_ns:
            self._flushing = True
            if not self._disk.submit(WHAT, self._flush):
                self._flushing, self._flush_failed = False, True

    def close(self) -> None:
        """Write the last line; queries that are still open stay unanswered."""
        self._sum_up()
        self._write("end")
        self._disk.submit(WHAT, self._flush)

    # --- lines ----------------------------------------------------------------------------------

    def _flush(self) -> None:
        """Flush in the disk's thread. A failure is tried again after a second."""
        self._flushing = False
        failed = True
        try:
            self._file.flush()
            failed = False
        finally:
            self._flush_failed = self._flush_failed or failed

    def _wrapped(self, inquiry: Inquiry) -> Inquiry:
        if ROUTES.get(inquiry.name) is Route.GATEWAY:
            return inquiry
        self._ticket += 1
        name, authenticated, payload = inquiry.name, inquiry.identity, inquiry.payload
        fields = _fields_of_query(payload)
        if authenticated:
            fields["client"] = authenticated
        elif self._have_keys and fields["client"] is not None:
            fields["client"] = claimed(fields["client"])
        query = LoggedQuery(inquiry, self, self._ticket, name, authenticated, payload, fields)
        self._open[self._ticket] = query
        return query

    def _has_budget(self, kind: str, query: LoggedQuery, outcome: str) -> bool:
        """True if this entry still gets a line in this minute; otherwise it is counted."""
        self._budget[kind] += 1
        if self._budget[kind] <= LINES_PER_MINUTE:
            return True
        client = str(query.fields.get("client"))
        key = (query.name[:NAME_LENGTH_MAX], client, outcome)
        others = len(self._summed) >= SUMMED_MAX and key not in self._summed
        self._summed[("others", "others", "others") if others else key] += 1
        return False

    def _sum_up(self) -> None:
        for (name, client, outcome), count in self._summed.items():
            self._write("summed", name=name, client=client, outcome=outcome, count=count)
        self._summed.clear()
        self._budget.clear()

    def _write(self, kind: str, **fields: object) -> None:
        if not self._file.has_room:
            self.lost_count += 1
            return
        if self.lost_count > self._lost_logged:
            lost, self._lost_logged = self.lost_count - self._lost_logged, self.lost_count
            self._write("lost", count=lost)
        at = datetime.fromtimestamp(self._utc_ns // 1000 / 1e6, UTC)
        head = {"utc": f"{at:%Y-%m-%dT%H:%M:%S.%fZ}", "kind": kind}
        core = {"core_boot_id": self._boot_id or None, "cycle": self._cycle}
        self._file.add(msgspec.json.encode({**head, **core, **fields}))


def unexpected_end(folder: Path, computer_boot_id: str) -> tuple[EventCode, str] | None:
    """How the gateway before this one ended, and when it was last heard of.

    Returns: None if it ended in order, or if there was none.

    Raises:
        OSError: the log cannot be read.
    """
    lines: list[bytes] = []
    known: list[dict[str, Any]] = []
    starts: list[dict[str, Any]] = []
    for path in reversed(files_of(folder)):  # the last start may be in an older, full file
        lines = [*path.read_bytes().splitlines(), *lines]
        known = [fields for fields in map(fields_of, lines) if fields is not None]
        starts = [fields for fields in known if fields.get("kind") == "start"]
        if starts:
            break
    if not lines or (fields_of(lines[-1]) or {}).get("kind") == "end":
        return None
    last = str(known[-1].get("utc")) if known else "?"
    killed = starts and starts[-1].get("computer_boot_id") == computer_boot_id
    return (EventCode.GATEWAY_KILLED if killed else EventCode.POWER_FAILED), last


def _fields_of_query(payload: bytes) -> dict[str, Any]:
    """Client and payload of a query: as JSON if it is a flat object, else as text."""
    found: Any = None
    with contextlib.suppress(RefusedError):
        found = ANYTHING.decode(payload or b"{}")
    if not isinstance(found, dict) or not all(map(_is_plain, found.values())):
        return {"client": None, "payload": payload.decode("utf-8", "backslashreplace")}
    client = found.get("client")
    named = client[:NAME_LENGTH_MAX] if isinstance(client, str) else None
    payload_fields = {key: SECRET if key == "lease" else value for key, value in found.items()}
    return {"client": named, "payload": payload_fields}


def _is_plain(value: object) -> bool:
    """True for a value that every JSON reader represents exactly; containers are excluded."""
    if isinstance(value, int):
        return abs(value) < 2**63
    return value is None or isinstance(value, str | float)
